"""Registers the app."""

from __future__ import annotations

from django.apps import AppConfig


class ApprovalsConfig(AppConfig):
    """`labweb.approvals`."""

    name = "labweb.approvals"
    label = "approvals"
