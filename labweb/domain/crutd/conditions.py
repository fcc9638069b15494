"""Pre- and post-conditions as data: what is read, what it must be, and what came out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any
from uuid import UUID

import msgspec


class Condition(msgspec.Struct, frozen=True, kw_only=True):
    """One statement about a status of a device, with a tolerance.

    `equals` compares exactly; `low`/`high` is a closed range; `change` compares the
    difference to the reading kept just before the start.
    """

    name: str
    """Code, `pump.valve_at_source`."""

    device_id: UUID
    status: str
    equals: bool | int | str | None = None
    low: float | None = None
    high: float | None = None
    change: float | None = None
    tolerance: float = 0.0
    timeout_s: float = 0.0
    """How long to wait for it to become true, after acting."""

    stable_status: str | None = None
    """A boolean status that must be true for the reading to count."""

    is_sensor: bool = False
    """The reading comes from an instrument other than the one that acts."""


class Verdict(StrEnum):
    """What came out."""

    PASS = "pass"  # noqa: S105 - a verdict, no secret
    FAIL = "fail"
    UNOBSERVABLE = "unobservable"
    """Nobody could look; never counted as a pass."""


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """Verdict and evidence of one condition."""

    name: str
    verdict: Verdict
    message: str
    evidence: dict[str, Any] = msgspec.field(default_factory=dict)


class Verification(StrEnum):
    """How surely an outcome is known; never claimed higher than it was."""

    SENSED = "sensed"
    """An instrument other than the one that acted saw it."""

    DEVICE = "device"
    """The acting device reported it."""

    ASSUMED = "assumed"
    """Nobody looked."""


Readings = Mapping[tuple[UUID, str], Any]
"""Fresh value by (device, status)."""


def evaluate(condition: Condition, now: Readings, before: Readings) -> Result:
    """Judge one condition on fresh readings; a missing reading is UNOBSERVABLE."""
    key = (condition.device_id, condition.status)
    if key not in now or now[key] is None:
        return Result(
            name=condition.name,
            verdict=Verdict.UNOBSERVABLE,
            message=f"{condition.status} could not be read",
        )
    value = now[key]
    evidence: dict[str, Any] = {"status": condition.status, "value": value}
    stable = condition.stable_status
    if stable is not None and not now.get((condition.device_id, stable)):
        return Result(
            name=condition.name,
            verdict=Verdict.UNOBSERVABLE,
            message=f"{condition.status} has not settled",
            evidence=evidence,
        )
    holds, wanted = _compare(condition, value, before.get(key))
    evidence["wanted"] = wanted
    if condition.change is not None:
        evidence["before"] = before.get(key)
    if holds is None:
        verdict, text = Verdict.UNOBSERVABLE, f"{condition.status} was not read before the start"
    else:
        verdict = Verdict.PASS if holds else Verdict.FAIL
        text = f"{condition.status} is {value}, wanted {wanted}"
    return Result(name=condition.name, verdict=verdict, message=text, evidence=evidence)


def _compare(condition: Condition, value: Any, before: Any) -> tuple[bool | None, str]:  # noqa: ANN401
    if condition.equals is not None:
        return value == condition.equals, f"{condition.equals}"
    number = float(value)
    if condition.change is not None:
        wanted = f"a change of {condition.change:g} ± {condition.tolerance:g}"
        if before is None:
            return None, wanted
        return abs(number - float(before) - condition.change) <= condition.tolerance, wanted
    low = -float("inf") if condition.low is None else condition.low - condition.tolerance
    high = float("inf") if condition.high is None else condition.high + condition.tolerance
    return low <= number <= high, f"{condition.low} to {condition.high}"


def verification_of(post: Sequence[tuple[Condition, Result]], *, reported: bool) -> Verification:
    """Return the surest verification that the passed conditions support."""
    passed = [condition for condition, result in post if result.verdict is Verdict.PASS]
    if any(condition.is_sensor for condition in passed):
        return Verification.SENSED
    if passed or reported:
        return Verification.DEVICE
    return Verification.ASSUMED
