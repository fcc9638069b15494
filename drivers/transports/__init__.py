"""Byte carriers: the only modules here that open anything."""
