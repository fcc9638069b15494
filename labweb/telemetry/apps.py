"""Registers the app."""

from __future__ import annotations

from django.apps import AppConfig


class TelemetryConfig(AppConfig):
    """`labweb.telemetry`."""

    name = "labweb.telemetry"
    label = "telemetry"
