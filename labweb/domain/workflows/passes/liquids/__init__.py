"""Passes that move liquid: which pump, through which valves, in which strokes."""
