"""Fresh readings for the conditions of an action."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any
from uuid import UUID

from labweb.domain.crutd.conditions import (
    Condition,
    Result,
    Verdict,
    evaluate,
    lacks_baseline,
    spread,
    statuses_of,
    unreadable_baselines,
)
from labweb.domain.errors import LabError
from labweb.domain.ports import Clock
from workers.store import Store
from workers.unit import Unit

OLDEST_READING_S = 3.0
"""A value of another line's device that is older tells nothing."""

POLL_S = 0.05
SPARE_S = 1.0
"""What a wait is longer in real time where lab time runs faster."""

Key = tuple[UUID, str]


class Reader:
    """Asks the devices of this line, and takes other lines' latest values from the store."""

    def __init__(self, units: Mapping[UUID, Unit], store: Store | None, clock: Clock) -> None:
        self._units = units
        self._store = store
        self._clock = clock

    def read(
        self, conditions: Iterable[Condition], since_s: float = float("-inf")
    ) -> dict[Key, Any]:
        """Read every status that the conditions name; one that cannot be read is left out.

        A status is read once, whatever is judged of it: its fields belong to one moment.

        Args:
            conditions: What is to be judged.
            since_s: A picture of another line's camera from before tells nothing.
        """
        wanted = list(conditions)
        pictured = {one.device_id for one in wanted if one.image_status is not None}
        found: dict[Key, Any] = {}
        for device_id, status in sorted(_keys(wanted)):
            oldest_s = since_s if device_id in pictured else float("-inf")
            value = self._value(device_id, status, oldest_s)
            if value is not None:
                found |= spread(device_id, status, value)
        return found

    def judge(
        self,
        conditions: Sequence[Condition],
        before: Mapping[Key, Any],
        since_s: float = float("-inf"),
    ) -> list[tuple[Condition, Result]]:
        """Judge the conditions on readings taken at this moment."""
        return judged(conditions, self.read(conditions, since_s), before)

    def await_all(
        self,
        conditions: Sequence[Condition],
        before: Mapping[Key, Any],
        *,
        is_over: Callable[[], bool],
    ) -> list[tuple[Condition, Result]] | None:
        """Judge the conditions, and give each its time to become true.

        A picture counts only when it was taken from here on: one from before the act, or
        from the middle of it, shows nothing of its end.

        Returns:
            None when `is_over` cut the waiting short: nothing is known yet.
        """
        began_s = self._clock.monotonic_s()
        while True:
            judged = self.judge(conditions, before, began_s)
            waited_s = self._lab_s(self._clock.monotonic_s() - began_s)
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

    def await_baselines(self, post: Sequence[Condition], *, is_over: Callable[[], bool]) -> bool:
        """Give what a change is measured from its time to settle, before the action begins.

        Returns:
            False when `is_over` cut the waiting short. True also where it does not settle: what
            cannot be read is judged before the start, what is not steady after the action.
        """
        began_s = self._clock.monotonic_s()
        while True:
            wanted = [one for one in post if one.change is not None]
            now = self.read(wanted) if wanted else {}
            waited_s = self._lab_s(self._clock.monotonic_s() - began_s)
            if not any(lacks_baseline(one, now) and waited_s < one.timeout_s for one in wanted):
                return True
            if is_over():
                return False
            self._clock.wait(POLL_S)

    def _lab_s(self, real_s: float) -> float:
        """Return the lab time in a real time, but for what links and this machine take."""
        pace = max((unit.driver.pace for unit in self._units.values()), default=1.0)
        return real_s if pace <= 1 else max(0.0, real_s - SPARE_S) * pace

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

    def _value(self, device_id: UUID, status: str, since_s: float) -> Any:  # noqa: ANN401 - any JSON value
        unit = self._units.get(device_id)
        if unit is not None:
            try:
                return unit.read(status)
            except LabError:
                return None
        sample = None if self._store is None else self._store.latest(device_id, status)
        if sample is None or sample.mono_s < since_s:
            return None
        if self._clock.monotonic_s() - sample.mono_s > OLDEST_READING_S:
            return None
        return sample.value


def judged(
    conditions: Sequence[Condition], now: Mapping[Key, Any], before: Mapping[Key, Any]
) -> list[tuple[Condition, Result]]:
    """Judge the conditions on readings of this moment that are there already."""
    return [(one, _evaluate(one, now, before)) for one in conditions]


def unconfirmable(
    post: Sequence[Condition], before: Mapping[Key, Any]
) -> list[tuple[Condition, Result]]:
    """Judge before the start what nobody could confirm after it."""
    by_name = {one.name: one for one in post}
    return [(by_name[result.name], result) for result in unreadable_baselines(post, before)]


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
    return {
        (one.device_id, status.partition(".")[0])
        for one in conditions
        for status in statuses_of(one)
    }
