"""People: users, what they may do where, and the record of who clicked what."""
