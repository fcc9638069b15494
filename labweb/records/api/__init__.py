"""REST of what is on record."""
