"""Where a host stands: its session, its hold after a restart, its stop latch.

A machine that was restarted moves nothing until the server has resumed its session. Which
start of the machine was armed is on disk, so that a second restart of the program alone
does not lift the hold.
"""

from __future__ import annotations

from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.canonical_json import canonical
from labweb.domain.messages.commands import Tick
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from labweb.domain.messages.session import Welcome
from labweb.domain.messages.stops import StopLabFrame
from labweb.domain.runs.halts import halted_setpoints
from labweb.domain.runs.host_actions.host_batch import stop_safely
from labweb.domain.runs.host_journal.action_states import ActionState, HostState
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_journal.journal_rows import JournalWrite

STATE_KEYS = (
    "host_id",
    "epoch",
    "floor",
    "armed_boot_id",
    "stop_id",
    "link_lost",
    "halted",
    "owed_halts",
    "server_clock",
)
"""The remembered values that `state_of` reads."""


def state_of(meta: dict[str, str], boot_id: str) -> HostState:
    """Read what decides whether anything may start from a host's remembered values."""
    clock, ahead_s = _server_clock(meta.get("server_clock"), boot_id)
    return HostState(
        host_id=UUID(meta["host_id"]),
        epoch=int(meta.get("epoch", 0)),
        floor=int(meta.get("floor", 0)),
        boot_id=boot_id,
        armed_boot_id=meta.get("armed_boot_id"),
        stop_latched="stop_id" in meta,
        offline_since_s=_offline_since_s(meta.get("link_lost"), boot_id),
        halted=msgspec.json.decode(meta.get("halted", "{}"), type=dict[str, int]),
        owes_halt=frozenset(msgspec.json.decode(meta.get("owed_halts", "{}"), type=dict[str, Any])),
        server_clock=clock,
        server_ahead_s=ahead_s,
    )


def _server_clock(text: str | None, boot_id: str) -> tuple[str, float]:
    """Read how far the server's clock is ahead; of an earlier boot nothing is known any more."""
    if text is None:
        return "", 0.0
    known_boot_id, clock, ahead_s = text.split(" ")
    return (clock, float(ahead_s)) if known_boot_id == boot_id else ("", 0.0)


def _offline_since_s(text: str | None, boot_id: str) -> float | None:
    """Read since when the server is away; from an earlier boot, since this one began."""
    if text is None:
        return None
    known_boot_id, _, mono_s = text.rpartition(" ")
    return float(mono_s) if known_boot_id == boot_id else 0.0


def offline_s(state: HostState, at: HostMoment) -> float | None:
    """Return for how long the server has been away, on the monotonic clock; None: it is there."""
    if state.offline_since_s is None:
        return None
    return max(at.mono_s - state.offline_since_s, 0.0)


def write_link_lost(tx: JournalWrite, at: HostMoment) -> list[UUID]:
    """Remember since when the server is away, and stop what is to be stopped then.

    Returns:
        Actions that act and are to be halted.
    """
    if state_of(tx.meta(), at.boot_id).offline_since_s is None:
        tx.set_meta("link_lost", f"{at.boot_id} {at.mono_s}")
        # An event, so that a copy of the journal from before does not begin the time anew.
        tx.append("link_lost", None, {"boot_id": at.boot_id})
    return stop_safely(tx)


def write_server_clock(tx: JournalWrite, tick: Tick | None, asked_at: HostMoment) -> None:
    """Remember how far the server's clock is ahead of the own one, at most.

    Args:
        tx: The write.
        tick: What the server told in its answer.
        asked_at: Before it was asked, so that the way there and back counts as time gone by.
    """
    if tick is None or not tick.clock or " " in tick.clock:
        tx.set_meta("server_clock", None)
        return
    ahead_s = tick.at_s - asked_at.mono_s
    tx.set_meta("server_clock", f"{asked_at.boot_id} {tick.clock} {ahead_s!r}")


def write_welcome(tx: JournalWrite, welcome: Welcome) -> None:
    """Remember a session's epoch and floor, devices and keys.

    Epoch and floor never go back. In quarantine the host is disarmed: nothing starts until
    the server resumes it.
    """
    meta = tx.meta()
    tx.set_meta("epoch", str(max(welcome.epoch, int(meta.get("epoch", 0)))))
    tx.set_meta("floor", str(max(welcome.floor, int(meta.get("floor", 0)))))
    write_devices(tx, welcome.devices, welcome.staged)
    tx.set_meta("command_keys", canonical(welcome.command_keys).decode())
    if welcome.mode != "normal":
        tx.set_meta("armed_boot_id", None)


def write_devices(
    tx: JournalWrite, devices: list[DeviceConfig], staged: list[DeviceConfig]
) -> None:
    """Remember what the host serves, and what it makes ready."""
    tx.set_meta("devices", canonical(devices).decode())
    tx.set_meta("staged", canonical(staged).decode())


def write_ack(tx: JournalWrite, seq: int) -> None:
    """Remember how far the server has committed; never further than there are events."""
    known = int(tx.meta().get("acked_seq", 0))
    tx.set_meta("acked_seq", str(max(known, min(seq, tx.head[0]))))


def write_boot(tx: JournalWrite, boot_id: str) -> None:
    """Tell, once for each start of the machine, that it has started."""
    if tx.meta().get("boot_id") != boot_id:
        tx.set_meta("boot_id", boot_id)
        tx.append("boot", None, {"boot_id": boot_id})


def write_armed(tx: JournalWrite, boot_id: str, regression: str | None) -> bool:
    """Let this start of the machine begin new work; False: the journal is not the newest.

    A journal that ends before its seal, or was put back from a copy, stays disarmed
    whatever the server says: actions may have happened that it does not know of.
    """
    if regression is not None:
        return False
    tx.set_meta("link_lost", None)
    if tx.meta().get("armed_boot_id") != boot_id:
        tx.set_meta("armed_boot_id", boot_id)
        tx.append("armed", None, {"boot_id": boot_id})
    return True


def write_disarmed(tx: JournalWrite) -> None:
    """Let nothing start here until the server has resumed a session."""
    tx.set_meta("armed_boot_id", None)


def write_stop(tx: JournalWrite, stop: StopLabFrame) -> None:
    """Close the stop latch, and void what the devices are set to: their lines halt them all.

    Only a signed Reset opens it. What acts is stopped as by a cancel, also by a line that comes
    to look at it only after that.
    """
    if tx.meta().get("stop_id") != str(stop.stop_id):
        tx.set_meta("stop_id", str(stop.stop_id))
        body = {"stop_id": str(stop.stop_id), "issued_by": stop.issued_by}
        tx.append("stop_latched", None, body)
        halted_setpoints.write_halts(tx, halted_setpoints.STOPPED)
        for row in tx.open_rows():
            if row.st in {ActionState.STARTED, ActionState.ACTUATED}:
                tx.want_cancel(row.action_id)
