"""Passes that check a plan as a whole: what it names, its order, its amounts."""
