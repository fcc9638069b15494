"""Calibrations of devices: how each is measured, judged, accepted and withdrawn."""
