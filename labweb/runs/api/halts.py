"""Render halts of devices as the browser reads them."""

from __future__ import annotations

from typing import Any

from labweb.common.render import iso
from labweb.runs import selectors
from labweb.runs.models import DeviceHalt, Run


def render_halts(run: Run) -> list[dict[str, Any]]:
    """Return what came of each device that an aborted run had set; none before it is aborted."""
    if not run.is_given_up:
        return []
    return [render_halt(row) for row in selectors.halts_of(run)]


def render_halt(row: DeviceHalt) -> dict[str, Any]:
    """Render one halt of one device."""
    return {
        "id": str(row.id),
        "device": {"id": str(row.device_id), "name": row.device.name},
        "state": row.state,
        "message": row.message,
        "at": iso(row.at),
        "ended_at": iso(row.ended_at),
        "run": None if row.run is None else {"id": str(row.run_id), "number": row.run.number},
        "by": None if row.asked_by is None else row.asked_by.printed_name,
    }
