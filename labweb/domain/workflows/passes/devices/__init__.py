"""Passes for what one device does by itself: heat, stir, measure, carry, look."""
