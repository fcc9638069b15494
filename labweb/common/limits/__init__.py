"""How much anybody may use at once, how often, and how much a process may take."""
