"""Passes that part, dry, boil off, evacuate, fill with gas or let react."""
