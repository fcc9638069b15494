"""One line: its devices, and the actions that are carried out on them, each at most once."""
