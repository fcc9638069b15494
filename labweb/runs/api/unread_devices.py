"""Render the devices of a run of which what stands is not read, as the browser reads them."""

from __future__ import annotations

from labweb.common.answers import NamedRef
from labweb.runs import selectors
from labweb.runs.answers.runs import SilentDevice
from labweb.runs.models import Run


def render_silent(run: Run) -> list[SilentDevice]:
    """Return each such device, since when, and what was set on it; three queries at most."""
    if run.started_at is None or run.state not in selectors.LIVE:
        return []
    return [
        SilentDevice(
            device=NamedRef(id=one.device.id, name=one.device.name),
            since_at=one.since_at,
            sentences=[job.sentence for job in one.jobs],
        )
        for one in selectors.silent_devices()
        if one.run.id == run.id
    ]
