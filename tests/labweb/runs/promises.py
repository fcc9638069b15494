"""What the dialogs about pause, abort and stop promise, and which test keeps each promise."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

Test = TypeVar("Test", bound=Callable[..., None])

_FILE = Path(__file__).parents[3] / "frontend/src/model/promises.json"

KEPT: dict[str, list[str]] = {}
"""Tests by the promise that they keep, word for word."""


def keeps(*promises: str) -> Callable[[Test], Test]:
    """Say which promises a test keeps; other words on the page need another look at it."""

    def note(test: Test) -> Test:
        for promise in promises:
            KEPT.setdefault(promise, []).append(test.__name__)
        return test

    return note


def promised() -> set[str]:
    """Return every promise that a dialog makes."""
    shown = json.loads(_FILE.read_text(encoding="utf-8"))
    return {text for dialog in shown.values() for text in dialog.values()}
