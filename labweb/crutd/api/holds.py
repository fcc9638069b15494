"""Render which runs keep a thing for themselves."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from uuid import UUID

from labweb.crutd.selectors.holds import live_on
from labweb.domain.runs.holding import Mode

_SHARED = {Mode.DRAW.value, Mode.POUR.value}


def render_keepers(ids: Iterable[UUID]) -> dict[UUID, list[dict[str, Any]]]:
    """Render the runs that hold things now, by thing; one query."""
    found: dict[UUID, list[dict[str, Any]]] = {}
    for row in live_on(list(ids)):
        found.setdefault(row.resource_id, []).append(
            {
                "run_id": str(row.run_id),
                "run": row.run_number,
                "until_step": row.until_step,
                "is_shared": row.mode in _SHARED,
            }
        )
    return found
