"""What a host remembers: the rows of its journal, the states of an action, what it reports."""
