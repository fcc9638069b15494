"""Documents packed from the record, and the record written anew from its events."""
