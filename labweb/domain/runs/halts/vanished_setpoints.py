"""A set-point that is gone: its device restarted, somebody turned its knob, its motor stalled.

It is what a halt does to one sort of what was set, and nobody has asked for it. The host sees it
in the readings that it takes anyway, and writes it down; the server applies the same rule to its
own rows, and the run is asked about as after a halt (`labweb.domain.runs.halts.halted_setpoints`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from labweb.domain.enrollment.setpoint_readback import KeptReading, names_set_by
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from labweb.domain.runs.halts.halted_setpoints import sort_of, sort_set_by
from labweb.domain.runs.halts.standing_setpoints import StandingSetpoint, put_stands, read_stands
from labweb.domain.runs.host_journal.action_states import ActionState
from labweb.domain.runs.host_journal.journal_rows import ActionRow, HeldResource, JournalWrite

VANISHED = "edge.setpoint_lost"
"""What an action had set is not there any more, and no halt took it away."""

EVENT = "setpoint_lost"


def note_complete(tx: JournalWrite, row: ActionRow) -> None:
    """Remember what a completed action leaves standing, or that it has ended what stood.

    One that did not complete changes nothing here: what stood before it is judged by the readings,
    as soon as it is known what became of it.
    """
    do = row.do
    sort = sort_of(do.action)
    if sort is None:
        return
    stands = None
    if sort_set_by(do.action, do.args) is not None:
        stands = StandingSetpoint(action_id=row.action_id, action=do.action, args=dict(do.args))
    put_stands(tx, row.device_id, sort, stands)


def gone_of(data: Mapping[str, Any], action: str) -> dict[str, None]:
    """Return what is unknown of a resource once what an action had set is gone.

    Example:
        >>> gone_of({"temperature_setpoint_c": 60.0, "temperature_c": 59.0}, "heat_to")
        {'temperature_setpoint_c': None}
    """
    return {name: None for name in sorted(names_set_by(action)) if data.get(name) is not None}


def write_vanished(
    tx: JournalWrite,
    device: DeviceConfig,
    stands: StandingSetpoint,
    kept: KeptReading,
    found: float,
) -> bool:
    """Write down that what an action had set is gone; False: it is not that action's any more.

    Where another action of its sort acts, has not ended on disk yet, or is in doubt, nothing is
    said: what is read may be of that one. Nor is anything while a halt of the device is owed: that
    takes away what was set, and is told as what it is.

    Effect:
        On the record only: what was set is unknown. The device is not touched.
    """
    sort = sort_of(stands.action)
    if sort is None or read_stands(tx.meta()).get(device.id, {}).get(sort) != stands:
        return False
    if str(device.id) in tx.host_state("").owes_halt:
        return False
    acting = {ActionState.STARTED, ActionState.ACTUATED, ActionState.IN_DOUBT}
    if any(
        row.device_id == device.id and row.st in acting and sort_of(row.do.action) == sort
        for row in tx.open_rows()
    ):
        return False
    put_stands(tx, device.id, sort, None)
    body: dict[str, Any] = {
        "device_id": str(device.id),
        "action_id": str(stands.action_id),
        "action": stands.action,
        "code": VANISHED,
        "message": kept.reason(found),
        "status": kept.status,
        "asked": kept.asked,
        "found": found,
        "data": {},
        "revs": {},
    }
    for held in _held(tx, device):
        gone = gone_of(held.view.data, stands.action)
        body["data"][str(held.view.id)] = gone
        if gone:
            rev = held.view.rev + 1
            view = msgspec.structs.replace(held.view, data={**held.view.data, **gone}, rev=rev)
            tx.put_resource(HeldResource(view=view, quarantined_by=held.quarantined_by))
            body["revs"][str(held.view.id)] = rev
    tx.append(EVENT, None, body)
    return True


def _held(tx: JournalWrite, device: DeviceConfig) -> Iterator[HeldResource]:
    for node in sorted(set(device.nodes.values())):
        held = tx.resource(node)
        if held is not None:  # what is unknown here the server knows more of
            yield held
