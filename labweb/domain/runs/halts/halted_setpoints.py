"""What a halt takes away: set-points that earlier actions of a device had left standing.

A halt brings a whole device to its safe state, whatever of it acted. What it was set to is unknown
from then on, until it is set anew: instruments keep the number while heater or motor is off.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.canonical_json import canonical
from labweb.domain.messages.commands import Halt
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from labweb.domain.runs.halts.standing_setpoints import clear_stands
from labweb.domain.runs.host_journal import paired_actions
from labweb.domain.runs.host_journal.action_states import ActionState
from labweb.domain.runs.host_journal.journal_rows import ActionRow, HeldResource, JournalWrite

STOPPED = "edge.stopped"
"""The lab was stopped."""

WITH_ACTION = "edge.halted"
"""An action was cancelled, overran, or its host was told to end: its whole device was halted."""

INTERRUPTED = "edge.interrupted"
"""The line of an action died; the one that followed halted the device."""

RUN_ABORTED = "edge.run_aborted"
"""The run that had set it was aborted."""

DEVICE_STOPPED = "edge.device_stopped"
"""A person stopped this device alone."""

MAY_MOVE = "its device may still move"
"""How it is told that nobody saw a halted device stand."""

LET_GO = "let_go"
"""A person goes on without what was taken away."""

IS_HALTED = "is_halted"
"""In the end of an action: its device was halted since it began, and what it set is gone."""


_SETPOINT = "_setpoint_"

_DRIVEN = frozenset(
    {
        "current_ma",
        "is_controlling",
        "is_heating",
        "is_pumping",
        "is_running",
        "speed_rpm",
        "voltage_v",
    }
)
"""Readings that a halt itself ends. A temperature or a pressure was read, and stays what it was."""

_BEGINS = {
    "evacuate_to": "vacuum",
    "heat_bath_to": "heat",
    "heat_to": "heat",
    "hold": "heat",
    "ramp_to": "heat",
    "reach_temperature": "heat",
    "rotate": "motion",
    "shake": "motion",
    "start_flow": "flow",
    "start_test": "test",
    "stir": "motion",
    "supply": "supply",
}
"""Actions of `drivers/interfaces` that return while what they began goes on."""

_ENDS = {
    "stop_control": "heat",
    "stop_flow": "flow",
    "stop_heating": "heat",
    "stop_pump": "vacuum",
    "stop_rotating": "motion",
    "stop_shaking": "motion",
    "stop_stirring": "motion",
    "stop_supply": "supply",
    "stop_test": "test",
    "vent": "vacuum",
}


def voided(data: Mapping[str, Any]) -> dict[str, None]:
    """Return what a halt makes unknown of what a device has left in its resource.

    Example:
        >>> voided({"speed_setpoint_rpm": 400.0, "speed_rpm": 398.0, "temperature_c": 60.1})
        {'speed_rpm': None, 'speed_setpoint_rpm': None}
    """
    names = (name for name in data if _SETPOINT in name or name in _DRIVEN)
    return {name: None for name in sorted(names) if data[name] is not None}


def is_undone_by_halt(action: str) -> bool:
    """Say whether a halt leaves nothing of what an action sets, also where it cuts it off.

    Then it is known what became of it: its device is in its safe state. Where a valve or a
    gripper stands that was halted in the middle is not.

    Example:
        >>> is_undone_by_halt("heat_to"), is_undone_by_halt("select_port")
        (True, False)
    """
    return action in _BEGINS or action in _ENDS


FOREIGN = {"call": "service", "run_goal": "goal"}
"""Actions of a foreign node, by the argument that names what is asked of it. What one has left
going, and what a halt makes of that, its maker knows: each is asked about."""


def is_halt_certain(action: str) -> bool:
    """Say whether a halt ends for certain what an action had begun; a foreign node's may go on."""
    return action not in FOREIGN


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """A completed action, as far as it left something standing."""

    index: int
    action: str
    args: Mapping[str, Any]
    is_known: bool = True
    """False: a person has given it up, and nobody knows what it did."""


def still_standing(done: Iterable[Done]) -> list[int]:
    """Return which completed actions of one device a halt takes something away of.

    Args:
        done: In the order in which they ended. Of each sort the last one counts, unless it
            was ended since; of a foreign node, of each goal and service. What nobody knows of
            takes no part.
    """
    return [one.index for one in _last_of_each_sort(one for one in done if one.is_known)]


def may_stand(done: Iterable[Done]) -> list[int]:
    """Return which given-up actions of one device may have left something going.

    Args:
        done: In the order in which they were sent, what nobody knows of among them. What was
            begun or ended since then says what the device is set to.
    """
    return [one.index for one in _last_of_each_sort(done) if not one.is_known]


def _last_of_each_sort(done: Iterable[Done]) -> list[Done]:
    standing: dict[str, Done] = {}
    for one in done:
        if one.action in _ENDS:
            if one.is_known:
                standing.pop(_ENDS[one.action], None)
        elif one.action in _BEGINS and not _is_timed(one):
            standing[_BEGINS[one.action]] = one
        elif one.action in FOREIGN:
            standing[f"{one.action} {one.args.get(FOREIGN[one.action])}"] = one
    return sorted(standing.values(), key=lambda one: one.index)


def sort_of(action: str) -> str | None:
    """Return the sort of what an action begins, or ends; None: neither."""
    return _BEGINS.get(action) or _ENDS.get(action)


def sort_set_by(action: str, args: Mapping[str, Any]) -> str | None:
    """Return the sort of what an action leaves standing once it completes; None: nothing."""
    one = Done(index=0, action=action, args=args)
    return None if _is_timed(one) else _BEGINS.get(action)


def leaves_standing(action: str, args: Mapping[str, Any]) -> bool:
    """Say whether a halt takes something away of an action that has just completed."""
    return bool(still_standing([Done(index=0, action=action, args=args)]))


def was_halted_since(told: Iterable[str]) -> bool:
    """Say whether a halt has taken away what an action set, by what its host has told.

    Args:
        told: `started` of the action and `halted` of its device, as they came since it was sent.
            Where the start was never told, nobody knows which came first, and so whether it
            still stands: it counts as taken away.

    Example:
        >>> was_halted_since(["halted", "started"]), was_halted_since(["started", "halted"])
        (False, True)
    """
    kinds = list(told)
    since = kinds[kinds.index("started") :] if "started" in kinds else kinds
    return "halted" in since


def _is_timed(one: Done) -> bool:
    """Say whether an action ended by itself what it began; heat is kept after a hold."""
    return one.is_known and "duration_s" in one.args and one.action != "hold"


# --- the host's side ----------------------------------------------------------------


def take_halt(tx: JournalWrite, halt: Halt) -> bool:
    """Write down that one device is to be halted; False: that is known, or was done before.

    It is owed from here on, and the process of its line delivers it, as after a stop of the lab.
    What acts there is cut off. Of a stop by a person, what waits there is given back: nothing
    begins at the device that nobody has asked for since.

    Effect:
        On the record only; the line halts the device.
    """
    if not tx.is_first_refusal(f"halt:{halt.halt_id}"):
        return False
    is_served = any(device.id == halt.device_id for device in _devices(tx))
    body = {
        "halt_id": str(halt.halt_id),
        "device_id": str(halt.device_id),
        "code": halt.code,
        "issued_by": halt.issued_by,
        "is_served": is_served,
    }
    tx.append("halt_taken", None, body)
    if not is_served:
        return True
    for row in tx.open_rows():
        if row.device_id != halt.device_id:
            continue
        if row.st is ActionState.STARTED:
            tx.want_cancel(row.action_id)
            paired_actions.halt_other(tx, row.do)
        elif row.st is ActionState.ACCEPTED and halt.code == DEVICE_STOPPED:
            tx.move(row.action_id, ActionState.ACCEPTED, ActionState.STOPPED)
            text = "its device was stopped before it started"
            told = {"code": halt.code, "message": text, "is_given_back": True}
            tx.append("stopped", row.action_id, told)
    owe_halt(tx, halt.device_id, halt.code, None)
    return True


def note_waiting(tx: JournalWrite, device_id: UUID, text: str) -> None:
    """Tell, once, why a halt that is owed was not delivered yet.

    Args:
        tx: The write.
        device_id: Which device.
        text: Why, as the line has found it.
    """
    owed = _owed(tx)
    due = owed.get(str(device_id))
    if due is None or due.text:
        return
    owed[str(device_id)] = msgspec.structs.replace(due, text=text)
    tx.set_meta("owed_halts", canonical(owed).decode())
    tx.append("halt_waits", None, {"device_id": str(device_id), "message": text})


def write_halts(tx: JournalWrite, code: str) -> None:
    """Write down that every device of this host is halted, each by the process of its line.

    It is owed from here on: that process may be away, or the device not answer, and the cause be
    over before either comes back.
    """
    devices = _devices(tx)
    for device in devices:
        _write_halt(tx, device, code, None)
    _owe(tx, [device.id for device in devices], code, None)


def write_halt(tx: JournalWrite, row: ActionRow, code: str) -> None:
    """Write down that a device was halted with one of its actions; a halt that is owed is why.

    Effect:
        On the record only: set-points of its resources are unknown.
    """
    due = _owed(tx).get(str(row.device_id))
    cause = code if due is None else due.code
    for device in _devices(tx):
        if device.id == row.device_id:
            _write_halt(tx, device, cause, row.action_id)


def halt_with_action(tx: JournalWrite, row: ActionRow, *, is_owed: bool) -> None:
    """Write down that a device was halted with its action, unless all of it was before.

    Args:
        tx: The write.
        row: The action.
        is_owed: The word was not delivered: it is to be, before anything else is done there.
    """
    if is_owed:
        owe_halt(tx, row.device_id, WITH_ACTION, row.action_id)
    if not was_halted(tx, row):
        write_halt(tx, row, WITH_ACTION)


class _Owed(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A halt that could not be delivered: why it is due, and for which action."""

    code: str
    action_id: UUID | None
    text: str = ""
    """Why it was not delivered yet, once that was told."""


def owe_halt(tx: JournalWrite, device_id: UUID, code: str, action_id: UUID | None) -> None:
    """Remember that a device has to be halted once it answers; until then nothing starts on it.

    The first cause stays, and the first action that waits to hear of it. It is on disk, so that no
    crash and no restart forgets it.
    """
    _owe(tx, [device_id], code, action_id)


def _owe(tx: JournalWrite, device_ids: Iterable[UUID], code: str, action_id: UUID | None) -> None:
    owed = _owed(tx)
    for key in map(str, device_ids):
        known = owed.get(key, _Owed(code=code, action_id=action_id))
        waits = known.action_id or action_id
        owed[key] = _Owed(code=known.code, action_id=waits, text=known.text)
    tx.set_meta("owed_halts", canonical(owed).decode())


def write_late_halt(
    tx: JournalWrite, device_id: UUID, text: str, readings: Mapping[str, Any]
) -> None:
    """Write down that a halt which was owed is delivered, and how the device was found then.

    Effect:
        On the record only: set-points of its resources are unknown. Actions may start on it.
    """
    owed = _owed(tx)
    due = owed.pop(str(device_id), None)
    if due is None:
        return
    tx.set_meta("owed_halts", canonical(owed).decode() if owed else None)
    for device in _devices(tx):
        if device.id == device_id:
            late = {"message": text, "evidence": dict(readings)}
            _write_halt(tx, device, due.code, due.action_id, late)


def _owed(tx: JournalWrite) -> dict[str, _Owed]:
    return msgspec.json.decode(tx.meta().get("owed_halts", "{}"), type=dict[str, _Owed])


def was_halted(tx: JournalWrite, row: ActionRow) -> bool:
    """Say whether the device of an action was halted since the action began."""
    host = tx.host_state(row.accepted_boot_id)
    return row.dseq <= host.halted.get(str(row.device_id), -1)


def _devices(tx: JournalWrite) -> list[DeviceConfig]:
    return msgspec.json.decode(tx.meta().get("devices", "[]"), type=list[DeviceConfig])


def _write_halt(
    tx: JournalWrite,
    device: DeviceConfig,
    code: str,
    action_id: UUID | None,
    late: Mapping[str, Any] | None = None,
) -> None:
    """Void what is set, and tell it; of a resource that is unknown here the server knows more."""
    data: dict[str, dict[str, None]] = {}
    revs: dict[str, int] = {}
    for node in sorted(set(device.nodes.values())):
        held = tx.resource(node)
        if held is None:
            continue
        data[str(node)] = voided(held.view.data)
        if data[str(node)]:
            revs[str(node)] = held.view.rev + 1
            view = msgspec.structs.replace(
                held.view, data={**held.view.data, **data[str(node)]}, rev=held.view.rev + 1
            )
            tx.put_resource(HeldResource(view=view, quarantined_by=held.quarantined_by))
    body = {
        "device_id": str(device.id),
        "code": code,
        "action_id": None if action_id is None else str(action_id),
        "data": data,
        "revs": revs,
        **(late or {}),
    }
    tx.append("halted", None, body)
    clear_stands(tx, device.id)
    halted = {**tx.host_state("").halted, str(device.id): tx.max_fence(device.id)}
    tx.set_meta("halted", canonical(halted).decode())
