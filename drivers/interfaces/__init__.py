"""Roles that drivers share; same names and parameters in each of them."""
