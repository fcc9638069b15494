"""Registers the app."""

from __future__ import annotations

from django.apps import AppConfig


class CalibrationConfig(AppConfig):
    """`labweb.calibration`."""

    name = "labweb.calibration"
    label = "calibration"
