"""Reads of what hosts told."""
