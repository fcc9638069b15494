"""Registers the app."""

from __future__ import annotations

from django.apps import AppConfig


class AccountsConfig(AppConfig):
    """`labweb.accounts`."""

    name = "labweb.accounts"
    label = "accounts"
