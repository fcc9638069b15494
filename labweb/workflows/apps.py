"""Registers the app."""

from __future__ import annotations

from django.apps import AppConfig


class WorkflowsConfig(AppConfig):
    """`labweb.workflows`."""

    name = "labweb.workflows"
    label = "workflows"
