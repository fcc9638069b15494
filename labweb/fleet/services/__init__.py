"""Writes about hosts and what they serve."""
