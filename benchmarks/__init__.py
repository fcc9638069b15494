"""Each figure in the README has one command here."""
