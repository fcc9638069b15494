"""Writes a new driver with its simulated instrument and its test, from a role's interface."""
