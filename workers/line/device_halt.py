"""Halt a device whose action nobody has seen end, and look at it once it stands."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any
from uuid import UUID

from labweb.domain.clock_and_ids import Clock
from labweb.domain.errors import LabError
from labweb.domain.runs.halts.device_motion import is_moving, tells_motion
from labweb.domain.runs.halts.halted_setpoints import MAY_MOVE, note_waiting, write_late_halt
from labweb.domain.runs.host_actions.action_execution import FoundDevice
from labweb.domain.runs.host_journal.event_bodies import plain
from labweb.domain.runs.host_journal.journal_rows import JournalError
from workers.journal.journal import Journal
from workers.line.device_unit import DeviceUnit

log = logging.getLogger(__name__)

REACH_S = 5.0
"""For how long the device is called: it may hold the connection of the process that died."""

STAND_S = 5.0
"""For how long it is watched until it stands."""

PAUSE_S = 0.25


def halt_and_look(unit: DeviceUnit | None, clock: Clock) -> FoundDevice:
    """Halt a device, and read its statuses until two readings in a row tell the same of motion.

    Effect:
        The device is in its safe state, where it can be reached. No action is sent.
    """
    if unit is None:
        text = f"{MAY_MOVE}: this host does not serve it"
        return FoundDevice(is_halted=False, is_owed=True, text=text)
    deadline_s = clock.monotonic_s() + REACH_S
    while not unit.is_online and clock.monotonic_s() < deadline_s:
        unit.connect_if_due()
        if not unit.is_online:
            clock.wait(PAUSE_S)
    if not unit.is_online:
        text = f"{MAY_MOVE}: it does not answer, and was not halted; it is once it answers"
        return FoundDevice(is_halted=False, is_owed=True, text=text)
    try:
        unit.halt()
    except LabError as error:
        # It may have heard the word all the same: what it was set to is not known either way.
        text = f"{MAY_MOVE}: it could not be halted, {error.message}"
        return FoundDevice(is_halted=True, is_owed=True, text=text, readings=_readings(unit))
    return _watched(unit, clock)


def _watched(unit: DeviceUnit, clock: Clock) -> FoundDevice:
    deadline_s = clock.monotonic_s() + STAND_S
    before = _readings(unit)
    while True:
        clock.wait(PAUSE_S)
        now = _readings(unit)
        silent = sorted(before.keys() ^ now.keys())
        changing = sorted(
            name
            for name in now
            if tells_motion(name) and is_moving(name, before.get(name), now[name])
        )
        if not changing and not silent:
            break
        if clock.monotonic_s() > deadline_s:
            names = ", ".join([*changing, *silent])
            text = f"{MAY_MOVE}: it was halted, and {names} did not come to rest"
            return FoundDevice(is_halted=True, text=text, readings=now)
        before = now
    if not now:
        unit.check_link()
    if not unit.is_online:
        # Some devices answer no command: that the word was sent says nothing.
        text = f"{MAY_MOVE}: it was told to halt, and does not answer"
        return FoundDevice(is_halted=True, is_owed=True, text=text)
    if not any(tells_motion(name) for name in now):
        text = "its device was halted; it tells nothing by which one sees that it stands"
        return FoundDevice(is_halted=True, text=text, readings=now)
    return FoundDevice(is_halted=True, text="its device was halted, and stands", readings=now)


def _readings(unit: DeviceUnit) -> dict[str, Any]:
    """Return every status that the device tells now; one that it cannot tell is left out."""
    found: dict[str, Any] = {}
    for name in unit.config.statuses:
        try:
            value = plain(unit.read(name))
            if value is not None:
                found[name] = value
        except LabError as error:
            log.warning("device %s does not tell %s: %s", unit.config.key, name, error)
    return found


SILENT = "it does not answer; it is halted as soon as it answers"

AGAIN_S = 1.0
"""How long until a halt that was refused, or could not be written down, is tried again."""


class LateHalts:
    """Halts the devices that could not be reached when they had to be, once they answer.

    Each in a thread of its own: a device that takes seconds to come to rest keeps neither the
    stop of the others waiting nor their actions.
    """

    def __init__(
        self,
        units: Mapping[UUID, DeviceUnit],
        clock: Clock,
        open_journal: Callable[[], Journal],
        wake: Callable[[], None],
    ) -> None:
        self._units = units
        self._clock = clock
        self._open_journal = open_journal
        self._wake = wake
        self._threads: dict[UUID, threading.Thread] = {}
        self._told: set[UUID] = set()
        """Devices of which it was told why they are not halted yet."""

    def look(self, owed: Iterable[str]) -> None:
        """Begin to halt those of the devices that answer, and tell once which do not.

        Raises:
            JournalError: Why one is not halted yet could not be written down.
        """
        due = set(map(UUID, owed))
        self._told &= due
        for device_id in sorted(due):
            unit, thread = self._units.get(device_id), self._threads.get(device_id)
            is_busy = thread is not None and thread.is_alive()
            if unit is None or unit.is_acting or is_busy:
                continue
            if not unit.is_online:
                self._tell_waiting(unit, SILENT)
                continue
            thread = threading.Thread(
                target=self._halt, args=(unit,), name="late-halt", daemon=True
            )
            self._threads[device_id] = thread
            thread.start()

    def _tell_waiting(self, unit: DeviceUnit, text: str) -> None:
        if unit.config.id in self._told:
            return
        journal = self._open_journal()
        try:
            with journal.write() as tx:
                note_waiting(tx, unit.config.id, text)
        finally:
            journal.close()
        self._told.add(unit.config.id)

    def _halt(self, unit: DeviceUnit) -> None:
        found = halt_and_look(unit, self._clock)
        try:
            if found.is_owed:
                log.warning("device %s: %s", unit.config.key, found.text)
                self._tell_waiting(unit, found.text)
                unit.check_link()
            else:
                journal = self._open_journal()
                try:
                    with journal.write() as tx:
                        write_late_halt(tx, unit.config.id, found.text, found.readings)
                finally:
                    journal.close()
                log.warning("device %s answers again: %s", unit.config.key, found.text)
                self._wake()
                return
        except JournalError as error:
            log.error("device %s was halted, which is not on disk yet: %s", unit.config.key, error)
        self._clock.wait(AGAIN_S)
