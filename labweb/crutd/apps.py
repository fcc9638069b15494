"""Registers the app."""

from __future__ import annotations

from django.apps import AppConfig


class CrutdConfig(AppConfig):
    """`labweb.crutd`."""

    name = "labweb.crutd"
    label = "crutd"
