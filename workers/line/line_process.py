"""The process of one line: its devices, its executor, its sampler, and the word to halt."""

from __future__ import annotations

import fcntl
import logging
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from uuid import UUID

from drivers.transports.base import Transport
from drivers.transports.urls import make_transport
from labweb.domain.clock_and_ids import Clock
from labweb.domain.errors import LabError
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from labweb.domain.runs.halts import halted_setpoints
from labweb.domain.runs.host_journal.journal_rows import JournalError
from workers.base.config import HostConfig, line_queue
from workers.base.device_lines import lines_of
from workers.base.system_clock import HostClock
from workers.base.valkey_store import ValkeyStore
from workers.journal.journal import Journal
from workers.line.action_files import ActionFiles
from workers.line.device_halt import LateHalts
from workers.line.device_unit import DeviceUnit
from workers.line.driver_reports import tell_once
from workers.line.driver_store import DriverLoader, DriverStore
from workers.line.executor import Executor
from workers.line.held_state_monitor import HeldStateMonitor
from workers.line.status_sampling import Sampler

log = logging.getLogger(__name__)

WATCH_S = 0.1
BELIEVE_S = 5.0
"""How long the word to halt counts by itself, should the latch not reach the disk."""


class LineProcess:
    """Everything that acts on one wire. One process holds it, by a lock on a file."""

    def __init__(
        self,
        config: HostConfig,
        line: str,
        wake: Callable[[str], None] = lambda _line: None,
    ) -> None:
        """Wait for the line's lock, load its drivers, and put in doubt what a crash left.

        Raises:
            LabError: The line has no devices, or a driver is not the approved one.
        """
        self.name = line
        self._config = config
        self._clock: Clock = HostClock()
        self._lock = _hold(config.folder / f"{line_queue(line)}.lock")
        self._journal = Journal(config.journal_path)
        self._store = ValkeyStore(config.valkey_url)
        self.units = self._load()
        self.is_draining = False
        self.is_leaving = False
        self.is_released = False
        """It has begun to let go of the wire."""

        self._is_ending = False
        self._closing = threading.Event()
        self._executor = Executor(
            self._journal,
            line,
            self.units,
            store=self._store,
            clock=self._clock,
            files=ActionFiles(config.files_of(line)),
            is_closing=self._closing.is_set,
            wake=wake,
        )
        for action_id in self._executor.recover():
            log.warning("action %s is in doubt: a crash left it without an answer", action_id)
        monitor = HeldStateMonitor(
            self.units, lambda: Journal(config.journal_path), self._clock, pace=config.pace
        )
        self._sampler = Sampler(line, self.units, self._store, self._clock, monitor)
        late = LateHalts(
            self.units, self._clock, lambda: Journal(config.journal_path), lambda: wake(line)
        )
        self._watch = StopWatch(config, line, self.units, self._closing, late)

    def _load(self) -> dict[UUID, DeviceUnit]:
        """Load the drivers, and tell the server which versions serve and which cannot."""
        devices = lines_of(self._journal.devices()).get(self.name, [])
        drivers = DriverLoader(
            DriverStore(self._config.drivers_folder), self._journal.command_keys()
        )
        units = make_units(
            devices, self._clock, drivers, self._tell_refused, pace=self._config.pace
        )
        for unit in units.values():
            tell_once(self._journal, unit.config, "driver_serving")
        return units

    def _tell_refused(self, device: DeviceConfig, error: LabError) -> None:
        tell_once(
            self._journal, device, "driver_refused", code=error.code, message=error.message[:2000]
        )

    @property
    def is_closing(self) -> bool:
        """Say whether nothing more starts."""
        return self._closing.is_set()

    def start(self) -> None:
        """Connect, sample, and listen for the word to halt."""
        self._sampler.start()
        self._watch.start()

    def drain(self) -> int:
        """Carry out what may start now."""
        self.is_draining = True
        try:
            return self._executor.drain()
        finally:
            self.is_draining = False

    def close(self) -> None:
        """Start nothing more; after the grace, halt the devices that still act."""
        if self._is_ending:
            return
        self._is_ending = True
        self._closing.set()
        timer = threading.Timer(self._config.stop_grace_s, self._halt_acting)
        timer.daemon = True
        timer.start()

    def leave(self) -> None:
        """Start nothing more, and let what acts run to its end: another process takes over."""
        self.is_leaving = True
        self._closing.set()

    def release(self) -> None:
        """Let go of the wire, at the end of the process, unless that has begun already.

        A signal may come while threads are waited for. What its handler would wait for then,
        it would wait for in vain.
        """
        if self.is_released:
            return
        self.is_released = True
        self._closing.set()
        self._watch.stop()
        self._sampler.stop()
        self._executor.close()
        for unit in self.units.values():
            unit.close()
        self._journal.close()
        self._store.close()
        os.close(self._lock)

    def _halt_acting(self) -> None:
        for unit in self.units.values():
            if unit.is_acting:
                unit.stop()


class StopWatch:
    """A thread that halts the devices as soon as the stop latch closes, and frees them after.

    The word comes over the host's Valkey; the latch in the journal is the truth, and is
    looked at ten times a second in case the word was lost. With it is seen whether a device
    that was out of reach owes a halt.
    """

    def __init__(
        self,
        config: HostConfig,
        line: str,
        units: dict[UUID, DeviceUnit],
        closing: threading.Event,
        late: LateHalts,
    ) -> None:
        self._config = config
        self._line = line
        self._units = units
        self._closing = closing
        self._late = late
        self._ending = threading.Event()
        self._is_halted = False
        self._believe_until_s = 0.0
        self._thread = threading.Thread(target=self._run, name="stop-watch", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End."""
        self._ending.set()
        self._thread.join(timeout=2.0)

    def _run(self) -> None:
        store = ValkeyStore(self._config.valkey_url)
        journal: Journal | None = None
        try:
            while not self._ending.is_set():
                journal = journal or self._open()
                self._look(journal)
                if store.wait_for_stop(self._line, wait_s=WATCH_S):
                    self._believe_until_s = time.monotonic() + BELIEVE_S
        finally:
            store.close()
            if journal is not None:
                journal.close()

    def _open(self) -> Journal | None:
        """Open the journal; None: it cannot be now, without a file left for it, say."""
        try:
            return Journal(self._config.journal_path)
        except JournalError:
            log.exception("the stop latch cannot be looked at")
            return None

    def _look(self, journal: Journal | None) -> None:
        owed: frozenset[str] = frozenset()
        try:
            if journal is None:
                raise JournalError("the journal is not open")
            host = journal.host_state()
            is_latched, owed = host.stop_latched, host.owes_halt
        except JournalError:
            log.exception("the stop latch cannot be read; devices are halted")
            is_latched = True
        is_latched = is_latched or time.monotonic() < self._believe_until_s
        if is_latched and not self._is_halted:
            self._is_halted = True
            _halt_all(self._units)
        elif journal and self._is_halted and not is_latched and not self._closing.is_set():
            self._release(journal)
        try:
            self._late.look(owed)
        except (JournalError, RuntimeError):  # no thread is left, say
            log.exception("halts that are owed cannot be delivered now")

    def _release(self, journal: Journal) -> None:
        """Let the devices act again; one that the halt has not reached is halted first.

        A stop that is on disk owes that already; one that came by word alone does not.
        """
        owing = [unit.config.id for unit in self._units.values() if unit.owes_halt]
        try:
            if owing:
                with journal.write() as tx:
                    for device_id in owing:
                        halted_setpoints.owe_halt(tx, device_id, halted_setpoints.STOPPED, None)
        except JournalError:
            log.exception("which devices are still to be halted is not on disk: none may act")
            return
        self._is_halted = False
        for unit in self._units.values():
            unit.clear_stop()


def _halt_all(units: dict[UUID, DeviceUnit]) -> None:
    """Halt all devices at once: on a slow wire the second must not wait for the first's answer."""
    for unit in units.values():
        try:
            threading.Thread(target=unit.stop, daemon=True).start()
        except RuntimeError:  # no thread is left
            unit.stop()


def make_units(
    devices: list[DeviceConfig],
    clock: Clock,
    drivers: DriverLoader,
    refuse: Callable[[DeviceConfig, LabError], None] = lambda _device, _error: None,
    *,
    pace: float = 1.0,
) -> dict[UUID, DeviceUnit]:
    """Load the drivers of one line over one shared transport; nothing is opened.

    A device whose driver cannot be loaded is left out, logged and told of: its actions wait
    until they expire, and the others go on.
    """
    shared: Transport | None = None
    units: dict[UUID, DeviceUnit] = {}
    for device in devices:
        try:
            transport = (
                make_transport(device.transport)
                if shared is None
                else shared.for_url(device.transport)
            )
            units[device.id] = DeviceUnit(device, drivers.load(device, transport), clock, pace)
        except LabError as error:
            log.error("device %s is not served: %s", device.key, error)  # the reason is whole
            refuse(device, error)
            continue
        shared = shared or transport
    return units


def _hold(path: Path) -> int:
    """Wait until no other process holds the line, then hold it for life."""
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    fcntl.flock(handle, fcntl.LOCK_EX)
    return handle
