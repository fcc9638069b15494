"""Where a lower floor gets what only a higher one has: by a dotted name in the settings."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from django.conf import settings


def wired(setting: str) -> ModuleType:
    """Return the module that a setting names; it does what a Protocol of the asking floor says.

    Raises:
        AttributeError: There is no such setting.
        ImportError: It names no module.
    """
    return import_module(getattr(settings, setting))
