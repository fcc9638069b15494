"""English, with the day by its number."""
