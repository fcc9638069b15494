"""Unit operations that a person can place, each with its parameters and its sentence."""
