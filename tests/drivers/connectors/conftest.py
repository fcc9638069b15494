"""Transcripts are played as fast as they can be."""

from __future__ import annotations

import pytest

from drivers.connectors import _motion


@pytest.fixture(autouse=True)
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_motion, "POLL_S", 0.001)
