"""Pauses, aborts, halts of devices, and the stop of the lab."""
