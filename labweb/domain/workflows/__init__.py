"""From a recipe to the ordered actions of one lab."""
