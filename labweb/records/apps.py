"""Registers the app."""

from __future__ import annotations

from django.apps import AppConfig


class RecordsConfig(AppConfig):
    """`labweb.records`."""

    name = "labweb.records"
    label = "records"
