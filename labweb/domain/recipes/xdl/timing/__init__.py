"""When the acts of a recipe happen, and what goes on in its vessels meanwhile."""
