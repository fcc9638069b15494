"""Registers the app."""

from __future__ import annotations

from django.apps import AppConfig


class FleetConfig(AppConfig):
    """`labweb.fleet`."""

    name = "labweb.fleet"
    label = "fleet"
