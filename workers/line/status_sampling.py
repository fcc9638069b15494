"""Keep the devices of one line connected and sample their statuses."""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping, Sequence
from uuid import UUID

import msgspec

from labweb.domain.clock_and_ids import Clock
from labweb.domain.errors import DeviceError, LabError
from labweb.domain.runs.host_journal.event_bodies import plain
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.domain.runs.host_link.host_clocks import ClockAnchor, Estimate, estimate
from workers.base.valkey_store import StatusSample, ValkeyStore
from workers.journal.journal import boot_id, since_boot_s
from workers.line.action_files import share_picture
from workers.line.device_unit import DeviceUnit
from workers.line.held_state_monitor import HeldStateMonitor

log = logging.getLogger(__name__)

TICK_S = 0.05
ALIVE_EVERY_S = 1.0
FAILURES_UNTIL_OFFLINE = 3


class Sampler:
    """A thread that asks between the exchanges of a running action.

    The transport carries one exchange at a time, so a sample waits for the wire and never
    the other way round for longer than one exchange.
    """

    def __init__(
        self,
        line: str,
        units: Mapping[UUID, DeviceUnit],
        store: ValkeyStore | None,
        clock: Clock,
        monitor: HeldStateMonitor | None = None,
    ) -> None:
        self._line = line
        self._units = list(units.values())
        self._store = store
        self._clock = clock
        self._monitor = monitor
        self._due_s: dict[tuple[UUID, str], float] = {}
        self._failures: dict[UUID, int] = {}
        self._taken_count = 0
        self._boot_id = boot_id()
        self._anchors: list[ClockAnchor] = []
        self._looked_s = float("-inf")
        self._began_s = self._now().at_s
        self._alive_s = float("-inf")
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sampler", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End, and wait for the current exchange."""
        self._ending.set()
        self._thread.join(timeout=5.0)

    @property
    def taken_count(self) -> int:
        """Samples taken so far."""
        return self._taken_count

    def sample_once(self) -> list[StatusSample]:
        """Connect what is due, ask for what is due, and hand it on."""
        samples: list[StatusSample] = []
        for unit in self._units:
            unit.connect_if_due()
            if unit.is_online:
                taken = self._ask(unit)
                samples += taken
                if self._monitor is not None:
                    self._monitor.note(unit, taken)
        self._taken_count += len(samples)
        if samples and self._store is not None:
            self._store.put(self._line, samples, self._taken_count, self._began_s)
        self._show_alive()
        return samples

    def _run(self) -> None:
        while not self._ending.is_set():
            try:
                self.sample_once()
            except OSError as error:  # no file is left for a connection, say: the next turn may go
                log.error("line %s cannot be sampled now: %s", self._line, error)
            self._clock.wait(TICK_S)
        if self._monitor is not None:
            self._monitor.close()

    def _ask(self, unit: DeviceUnit) -> Sequence[StatusSample]:
        now_s = self._clock.monotonic_s()
        samples = []
        for status, usual_s in unit.config.statuses.items():
            watched = self._monitor
            period_s = usual_s if watched is None else watched.period_s(unit, status, usual_s)
            key = (unit.config.id, status)
            due_s = self._due_s.get(key, now_s)
            if now_s + period_s < due_s < float("inf"):  # watched from now on
                due_s = self._due_s[key] = now_s + period_s
            if now_s < due_s or not unit.is_online:
                continue
            # On from when it was due, else each look that comes late would slow it down.
            step_s = max(period_s, TICK_S)
            self._due_s[key] = (due_s if now_s - due_s < step_s else now_s) + step_s
            asked_s = self._clock.monotonic_s()
            try:
                value = plain(unit.read(status))
            except DeviceError as error:
                self._note_failure(unit, error)
                continue
            except LabError as error:
                log.warning("device %s: %s", unit.config.key, error)
                self._due_s[key] = float("inf")
                continue
            self._failures[unit.config.id] = 0
            if self._store is not None:
                share_picture(self._store, unit, value)
            if value is None:  # the device cannot tell: a gap stays a gap
                continue
            at = self._now()
            samples.append(
                StatusSample(
                    device_id=str(unit.config.id),
                    status=status,
                    at_s=at.at_s,
                    mono_s=asked_s,
                    value=value,
                    uncertainty_s=at.uncertainty_s,
                )
            )
        return samples

    def _now(self) -> Estimate:
        """Return this moment by the server's clock, as it was measured last."""
        now_s = self._clock.monotonic_s()
        if self._store is not None and now_s - self._looked_s >= ALIVE_EVERY_S:
            self._looked_s = now_s
            text = self._store.anchor()
            self._anchors = [] if text is None else [msgspec.json.decode(text, type=ClockAnchor)]
        at = HostMoment(boot_id=self._boot_id, mono_s=since_boot_s(), wall_s=self._clock.now_s())
        return estimate(self._anchors, at)

    def _note_failure(self, unit: DeviceUnit, error: DeviceError) -> None:
        count = self._failures.get(unit.config.id, 0) + 1
        self._failures[unit.config.id] = count
        if count >= FAILURES_UNTIL_OFFLINE:
            log.warning("device %s: %s", unit.config.key, error)
            self._failures[unit.config.id] = 0
            unit.lose_link()

    def _show_alive(self) -> None:
        now_s = self._clock.monotonic_s()
        if self._store is not None and now_s - self._alive_s >= ALIVE_EVERY_S:
            self._alive_s = now_s
            self._store.show_alive(self._line, now_s)
