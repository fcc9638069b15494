"""Registers the app."""

from __future__ import annotations

from django.apps import AppConfig


class ResourcesConfig(AppConfig):
    """`labweb.resources`."""

    name = "labweb.resources"
    label = "resources"
