"""Render halts of devices as the browser reads them."""

from __future__ import annotations

from labweb.common.answers import NamedRef, NumberedRef
from labweb.domain.runs.halts.halt_progress import HaltState
from labweb.runs import selectors
from labweb.runs.answers.runs import DeviceHaltRow
from labweb.runs.models import DeviceHalt, Run


def render_halts(run: Run) -> list[DeviceHaltRow]:
    """Return what came of each device that an aborted run had set; none before it is aborted."""
    if not run.is_given_up:
        return []
    return [render_halt(row) for row in selectors.halts_of(run)]


def render_halt(row: DeviceHalt) -> DeviceHaltRow:
    """Render one halt of one device."""
    return DeviceHaltRow(
        id=row.id,
        device=NamedRef(id=row.device_id, name=row.device.name),
        state=HaltState(row.state),
        message=row.message,
        at=row.at,
        ended_at=row.ended_at,
        run=None if row.run is None else NumberedRef(id=row.run.id, number=row.run.number),
        by=None if row.asked_by is None else row.asked_by.printed_name,
    )
