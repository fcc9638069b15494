"""Writes of calibrations, and how each quantity is measured and judged."""
