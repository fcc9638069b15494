"""Watches, between actions, that what completed ones have set still stands on its devices."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from uuid import UUID

from labweb.domain.clock_and_ids import Clock
from labweb.domain.enrollment.setpoint_readback import (
    SURE_S,
    KeptReading,
    Seen,
    completed,
    kept_by,
    look,
)
from labweb.domain.runs.halts.halted_setpoints import sort_of
from labweb.domain.runs.halts.standing_setpoints import KEY, StandingSetpoint, read_stands
from labweb.domain.runs.halts.vanished_setpoints import write_vanished
from labweb.domain.runs.host_journal.journal_rows import JournalError
from workers.base.valkey_store import StatusSample
from workers.journal.journal import Journal
from workers.line.device_unit import DeviceUnit

log = logging.getLogger(__name__)

REFRESH_S = 0.25
"""How often the journal is asked what stands, real time."""

OFTEN_S = SURE_S
"""A reading that shows whether something stands is taken at least so often, lab time."""

SHORTEST_S = 0.1
"""Real time between two such readings, however fast lab time runs."""


@dataclass(frozen=True, slots=True)
class WatchedReading:
    """One reading that shows whether something stands."""

    action_id: UUID
    sort: str | None
    kept: KeptReading


class HeldStateMonitor:
    """Looks at each sample of the line's devices, on the thread that takes them."""

    def __init__(
        self,
        units: Mapping[UUID, DeviceUnit],
        open_journal: Callable[[], Journal],
        clock: Clock,
        *,
        pace: float = 1.0,
    ) -> None:
        self._units = units
        self._open_journal = open_journal
        self._journal: Journal | None = None
        self._clock = clock
        self._pace = pace
        self._refreshed_s = float("-inf")
        self._stands: dict[UUID, dict[UUID, StandingSetpoint]] = {}
        self._seen: dict[UUID, dict[WatchedReading, Seen]] = {}

    def period_s(self, unit: DeviceUnit, status: str, period_s: float) -> float:
        """Return how often a status is asked for, real time: one that shows what stands, often."""
        if any(one.kept.status == status for one in self._seen.get(unit.config.id, {})):
            return min(period_s, max(OFTEN_S / self._pace, SHORTEST_S))
        return period_s

    def note(self, unit: DeviceUnit, samples: Iterable[StatusSample]) -> None:
        """Look at samples of one device, and write down what is gone."""
        self._refresh()
        watched = self._seen.get(unit.config.id)
        if not watched:
            return
        values = {sample.status: sample for sample in samples}
        for one, seen in list(watched.items()):
            sample = values.get(one.kept.status)
            if one.sort == sort_of(unit.acting):
                watched[one] = completed(one.kept)  # what is read may be of the action that acts
            elif sample is not None:
                at_s = sample.mono_s * self._pace
                watched[one] = look(one.kept, seen, sample.value, at_s)
                if watched[one].is_lost:
                    self._tell(unit, one, sample.value)
                    return

    def close(self) -> None:
        """Let go of the journal."""
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def _refresh(self) -> None:
        now_s = self._clock.monotonic_s()
        if now_s - self._refreshed_s < REFRESH_S:
            return
        self._refreshed_s = now_s
        try:
            if self._journal is None:
                self._journal = self._open_journal()
            text = self._journal.meta(KEY)
        except JournalError as error:
            log.error("what stands on the devices cannot be read: %s", error)
            return
        found = read_stands({} if text is None else {KEY: text})
        mine = {one: list(found[one].values()) for one in found if one in self._units}
        self._stands = {one: {each.action_id: each for each in all_} for one, all_ in mine.items()}
        self._seen = {one: self._watched(self._units[one], all_) for one, all_ in mine.items()}

    def _watched(
        self, unit: DeviceUnit, stands: Iterable[StandingSetpoint]
    ) -> dict[WatchedReading, Seen]:
        """Return what is to be looked at of a device, with what was seen of it before."""
        before = self._seen.get(unit.config.id, {})
        keys = [
            WatchedReading(one.action_id, sort_of(one.action), kept)
            for one in stands
            for kept in kept_by(one.action, one.args, unit.config.statuses)
        ]
        return {key: before.get(key, completed(key.kept)) for key in keys}

    def _tell(self, unit: DeviceUnit, one: WatchedReading, found: float) -> None:
        """Write the loss down, with which the server is told; the device is left as it is."""
        journal, text = self._journal, one.kept.reason(found)
        stands = self._stands[unit.config.id][one.action_id]
        self._seen[unit.config.id][one] = completed(
            one.kept
        )  # looked at anew, should it not be told
        if journal is None:
            return
        try:
            with journal.write() as tx:
                is_told = write_vanished(tx, unit.config, stands, one.kept, found)
        except JournalError as error:
            log.error("device %s: %s, which is not on disk yet: %s", unit.config.key, text, error)
            return
        if is_told:
            log.warning("device %s: %s", unit.config.key, text)
            self._refreshed_s = float("-inf")
