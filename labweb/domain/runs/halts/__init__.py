"""Halts of devices, and the set-points that stand on them until one comes."""
