"""Render the devices of a run of which what stands is not read, as the browser reads them."""

from __future__ import annotations

from typing import Any

from labweb.common.render import iso
from labweb.runs import selectors
from labweb.runs.models import Run


def render_silent(run: Run) -> list[dict[str, Any]]:
    """Return each such device, since when, and what was set on it; three queries at most."""
    if run.started_at is None or run.state not in selectors.LIVE:
        return []
    return [
        {
            "device": {"id": str(one.device.id), "name": one.device.name},
            "since_at": iso(one.since_at),
            "sentences": [job.sentence for job in one.jobs],
        }
        for one in selectors.silent_devices()
        if one.run.id == run.id
    ]
