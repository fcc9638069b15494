"""Workflows that people draw, and their immutable versions."""
