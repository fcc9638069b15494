"""Fresh readings for the conditions of an action."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.clock_and_ids import Clock
from labweb.domain.crutd.pre_and_postconditions import (
    Condition,
    ConditionResult,
    ConditionVerdict,
    evaluate,
    lacks_baseline,
    spread,
    statuses_of,
    unreadable_baselines,
)
from labweb.domain.errors import LabError
from labweb.domain.runs.host_journal.journal_rows import ActionRow
from workers.base.valkey_store import StatusSample, ValkeyStore
from workers.line.device_unit import DeviceUnit

OLDEST_READING_S = 3.0
"""A value of another line's device that is older tells nothing."""

POLL_S = 0.05
SLOWEST_POLL_S = 1.0
POLL_RATIO = 0.01
"""A condition is looked at again after that share of the time that it has taken by then."""

SPARE_S = 1.0
"""What a wait is longer in real time where lab time runs faster."""

Key = tuple[UUID, str]


class ConditionReader:
    """Asks the devices of this line, and takes other lines' latest values from the store."""

    def __init__(
        self, units: Mapping[UUID, DeviceUnit], store: ValkeyStore | None, clock: Clock
    ) -> None:
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

    def read_now(
        self,
        conditions: Sequence[Condition],
        also: Iterable[Condition],
        *,
        is_over: Callable[[], bool],
    ) -> dict[Key, Any]:
        """Read as `read`, and judge nothing by what another line's device told too long ago.

        Where a condition fails by what such a device told before this moment, its next sample is
        waited for, as long as a sample may be old.
        """
        began_s = self._clock.monotonic_s()
        also = list(also)
        while True:
            found = self.read([*conditions, *also])
            failed = [
                one
                for one, result in judged(conditions, found, {})
                if result.verdict is not ConditionVerdict.PASS and one.device_id not in self._units
            ]
            is_late = self._clock.monotonic_s() - began_s > OLDEST_READING_S
            if is_late or is_over() or not any(self._is_older(one, began_s) for one in failed):
                return found
            self._clock.wait(POLL_S)

    def _is_older(self, condition: Condition, than_s: float) -> bool:
        """Say whether another line's device has told of a condition only before a moment."""
        if self._store is None:
            return False
        names = {status.partition(".")[0] for status in statuses_of(condition)}
        told = [self._store.latest(condition.device_id, name) for name in names]
        return any(one is None or one.mono_s < than_s for one in told)

    def await_all(
        self,
        conditions: Sequence[Condition],
        before: Mapping[Key, Any],
        *,
        is_over: Callable[[], bool],
        is_cut: Callable[[], bool] = lambda: False,
    ) -> list[tuple[Condition, ConditionResult]] | None:
        """Judge the conditions, and give each its time to become true, or until `is_cut`.

        A picture counts only when it was taken from here on: one from before the act, or
        from the middle of it, shows nothing of its end.

        Returns:
            None when `is_over` cut the waiting short: nothing is known yet.
        """
        began_s = self._clock.monotonic_s()
        while True:
            now = self.read(conditions, began_s)
            found = judged(conditions, now, before)
            waited_s = self._lab_s(self._clock.monotonic_s() - began_s)
            hopeful = [
                one
                for one, result in found
                if result.verdict is not ConditionVerdict.PASS and waited_s < one.timeout_s
            ]
            if not hopeful or is_cut():
                self._share(now)
                return found
            if is_over():
                return None
            # What is waited for by the hour is not looked at twenty times a second.
            self._clock.wait(min(max(POLL_S, waited_s * POLL_RATIO), SLOWEST_POLL_S))

    def _share(self, now: Mapping[Key, Any]) -> None:
        """Let other lines see how an act has left the devices of this one.

        A pump on its own line is to find its valve where it was turned to, not where the last
        sample has seen it.
        """
        own = [key for key in now if key[0] in self._units and "." not in key[1]]
        if self._store is None or not own:
            return
        at_s, mono_s = self._clock.now_s(), self._clock.monotonic_s()
        self._store.share(
            [
                StatusSample(str(device), status, at_s, mono_s, now[device, status])
                for device, status in own
            ]
        )

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
) -> list[tuple[Condition, ConditionResult]]:
    """Judge the conditions on readings of this moment that are there already."""
    return [(one, _evaluate(one, now, before)) for one in conditions]


def unconfirmable(
    post: Sequence[Condition], before: Mapping[Key, Any]
) -> list[tuple[Condition, ConditionResult]]:
    """Judge before the start what nobody could confirm after it."""
    by_name = {one.name: one for one in post}
    return [(by_name[result.name], result) for result in unreadable_baselines(post, before)]


def _evaluate(
    condition: Condition, now: Mapping[Key, Any], before: Mapping[Key, Any]
) -> ConditionResult:
    """Judge one condition; a text where a number is wanted tells nothing."""
    try:
        return evaluate(condition, now, before)
    except (TypeError, ValueError):
        text = f"{condition.status} is no number"
        return ConditionResult(
            name=condition.name, verdict=ConditionVerdict.UNOBSERVABLE, message=text
        )


def prestate_body(readings: Mapping[Key, Any]) -> dict[str, Any]:
    """Render readings for the journal."""
    return {"readings": [[str(device), status, v] for (device, status), v in readings.items()]}


def prestate_from(body: Mapping[str, Any]) -> dict[Key, Any]:
    """Read the readings that were kept in the journal."""
    return {(UUID(device), status): value for device, status, value in body.get("readings", [])}


def _keys(conditions: Iterable[Condition]) -> set[Key]:
    return {
        (one.device_id, status.partition(".")[0])
        for one in conditions
        for status in statuses_of(one)
    }


def conditions_of(plain_conditions: list[dict[str, Any]]) -> list[Condition]:
    """Return the conditions of an action, which its row holds as plain data."""
    return msgspec.convert(plain_conditions, list[Condition])


def readings_before(row: ActionRow) -> Mapping[Key, Any]:
    """Return what was read before an action began."""
    return prestate_from(msgspec.json.decode(row.prestate or '{"readings": []}'))
