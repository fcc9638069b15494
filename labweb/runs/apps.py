"""Registers the app."""

from __future__ import annotations

from django.apps import AppConfig


class RunsConfig(AppConfig):
    """`labweb.runs`."""

    name = "labweb.runs"
    label = "runs"
