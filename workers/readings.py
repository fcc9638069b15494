"""Fresh readings for the conditions of an action."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any
from uuid import UUID

from labweb.domain.crutd.conditions import Condition, Result, Verdict, evaluate, statuses_of
from labweb.domain.errors import LabError
from labweb.domain.ports import Clock
from workers.store import Store
from workers.unit import Unit

OLDEST_READING_S = 3.0
"""A value of another line's device that is older tells nothing."""

POLL_S = 0.05

Key = tuple[UUID, str]


class Reader:
    """Asks the devices of this line, and takes other lines' latest values from the store."""

    def __init__(self, units: Mapping[UUID, Unit], store: Store | None, clock: Clock) -> None:
        self._units = units
        self._store = store
        self._clock = clock

    def read(self, conditions: Iterable[Condition]) -> dict[Key, Any]:
        """Read every status that the conditions name; one that cannot be read is left out."""
        found: dict[Key, Any] = {}
        for device_id, status in sorted(_keys(conditions)):
            value = self._value(device_id, status)
            if value is not None:
                found[device_id, status] = value
        return found

    def judge(
        self, conditions: Sequence[Condition], before: Mapping[Key, Any]
    ) -> list[tuple[Condition, Result]]:
        """Judge the conditions on readings taken at this moment."""
        readings = self.read(conditions)
        return [(one, _evaluate(one, readings, before)) for one in conditions]

    def await_all(
        self,
        conditions: Sequence[Condition],
        before: Mapping[Key, Any],
        *,
        is_over: Callable[[], bool],
    ) -> list[tuple[Condition, Result]] | None:
        """Judge the conditions, and give each its time to become true.

        Returns:
            None when `is_over` cut the waiting short: nothing is known yet.
        """
        began_s = self._clock.monotonic_s()
        while True:
            judged = self.judge(conditions, before)
            waited_s = self._clock.monotonic_s() - began_s
            hopeful = [
                one
                for one, result in judged
                if result.verdict is not Verdict.PASS and waited_s < one.timeout_s
            ]
            if not hopeful:
                return judged
            if is_over():
                return None
            self._clock.wait(POLL_S)

    def latest(self, devices: Iterable[UUID]) -> list[tuple[str, str, Any, float]]:
        """Return (device, status, value, age in seconds) of the last samples; asks no device."""
        wanted = list(devices)
        if self._store is None or not wanted:
            return []
        now_s = self._clock.monotonic_s()
        return [
            (sample.device_id, sample.status, sample.value, now_s - sample.mono_s)
            for sample in self._store.latest_of(wanted)
        ]

    def _value(self, device_id: UUID, status: str) -> Any:  # noqa: ANN401 - any JSON value
        unit = self._units.get(device_id)
        if unit is not None:
            try:
                return unit.read(status)
            except LabError:
                return None
        sample = None if self._store is None else self._store.latest(device_id, status)
        if sample is None or self._clock.monotonic_s() - sample.mono_s > OLDEST_READING_S:
            return None
        return sample.value


def _evaluate(condition: Condition, now: Mapping[Key, Any], before: Mapping[Key, Any]) -> Result:
    """Judge one condition; a text where a number is wanted tells nothing."""
    try:
        return evaluate(condition, now, before)
    except (TypeError, ValueError):
        text = f"{condition.status} is no number"
        return Result(name=condition.name, verdict=Verdict.UNOBSERVABLE, message=text)


def prestate_body(readings: Mapping[Key, Any]) -> dict[str, Any]:
    """Render readings for the journal."""
    return {"readings": [[str(device), status, v] for (device, status), v in readings.items()]}


def prestate_from(body: Mapping[str, Any]) -> dict[Key, Any]:
    """Read the readings that were kept in the journal."""
    return {(UUID(device), status): value for device, status, value in body["readings"]}


def _keys(conditions: Iterable[Condition]) -> set[Key]:
    return {(one.device_id, status) for one in conditions for status in statuses_of(one)}
