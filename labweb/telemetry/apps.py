"""Registers the app."""

from __future__ import annotations

from django.apps import AppConfig
from django.conf import settings
from django.core.exceptions import ImproperlyConfigured

from labweb.domain.telemetry_resolution import check_ages


class TelemetryConfig(AppConfig):
    """`labweb.telemetry`."""

    name = "labweb.telemetry"
    label = "telemetry"

    def ready(self) -> None:
        """Refuse ages by which a bucket could outlive what it is computed from."""
        wrong = check_ages(settings.TELEMETRY_KEEP_S)
        if wrong:
            raise ImproperlyConfigured(f"LABWEB_TELEMETRY_KEEP_…: {'; '.join(wrong)}")
