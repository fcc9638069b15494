"""Registers the app."""

from __future__ import annotations

from django.apps import AppConfig


class EnrollmentConfig(AppConfig):
    """`labweb.enrollment`."""

    name = "labweb.enrollment"
    label = "enrollment"
