"""Small pieces that every answer shares."""

from __future__ import annotations

from datetime import datetime


def iso(at: datetime | None) -> str | None:
    """Write a time as ISO 8601, UTC."""
    return None if at is None else at.isoformat().replace("+00:00", "Z")
