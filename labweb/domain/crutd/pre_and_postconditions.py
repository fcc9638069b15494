"""Pre- and post-conditions as data: what is read, what it must be, and what came out."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any
from uuid import UUID

import msgspec

from labweb.domain.enrollment.status_wording import spoken_name, spoken_value


class Condition(msgspec.Struct, frozen=True, kw_only=True):
    """One statement about a status of a device, with a tolerance.

    `equals` compares exactly; `low`/`high` is a closed range; `change` compares the
    difference to the reading kept just before the start.
    """

    name: str
    """Code, `pump.valve_at_source`."""

    device_id: UUID
    status: str
    """A name, or `name.field` for one field of a reading that has several."""

    equals: bool | int | str | None = None
    low: float | None = None
    high: float | None = None
    change: float | None = None
    tolerance: float = 0.0
    timeout_s: float = 0.0
    """How long to wait for it to become true, after acting."""

    stable_status: str | None = None
    """A boolean status that must be true for the reading to count."""

    confidence_status: str | None = None
    """A status that says how sure the reading is, 0 to 1: of a camera that looks for a vessel
    or reads a tag."""

    min_confidence: float = 1.0
    """Less sure than this, the reading tells nothing."""

    image_status: str | None = None
    """A status that names the image the reading was taken from, by its SHA-256: evidence."""

    is_sensor: bool = False
    """The reading comes from an instrument other than the one that acts."""

    may_stay_unconfirmed: bool = False
    """The step says so: when nobody could look after acting, the action is complete and
    *unconfirmed*. Otherwise nobody knows what happened, and it is in doubt."""


def sees_vessel(
    camera_id: UUID, *, is_present: bool, min_confidence: float, timeout_s: float = 0.0
) -> Condition:
    """Require that a camera sees that a vessel stands at its place, or that none does."""
    return Condition(
        name="camera.presence",
        device_id=camera_id,
        status="sighting.is_present",
        equals=is_present,
        confidence_status="sighting.presence_confidence_ratio",
        min_confidence=min_confidence,
        image_status="sighting.image_sha256",
        timeout_s=timeout_s,
        is_sensor=True,
    )


def sees_tag(
    camera_id: UUID, tag: str, *, min_confidence: float, timeout_s: float = 0.0
) -> Condition:
    """Require that a camera reads that tag on what stands at its place."""
    presence = sees_vessel(
        camera_id, is_present=True, min_confidence=min_confidence, timeout_s=timeout_s
    )
    return msgspec.structs.replace(
        presence,
        name="camera.tag",
        status="sighting.tag",
        equals=tag,
        confidence_status="sighting.tag_confidence_ratio",
    )


class ConditionVerdict(StrEnum):
    """What came out."""

    PASS = "pass"  # noqa: S105 - a verdict, no secret
    FAIL = "fail"
    UNOBSERVABLE = "unobservable"
    """Nobody could look; never counted as a pass."""


class ConditionResult(msgspec.Struct, frozen=True, kw_only=True):
    """Verdict and evidence of one condition."""

    name: str
    verdict: ConditionVerdict
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

    UNCONFIRMED = "unconfirmed"
    """The step asked for a confirmation that could not be made, and lets it stay so."""


Readings = Mapping[tuple[UUID, str], Any]
"""Fresh value by (device, status)."""


def spread(device_id: UUID, status: str, value: Any) -> dict[tuple[UUID, str], Any]:  # noqa: ANN401
    """Return a reading as readings: one that has fields is one for each of them.

    Example:
        >>> list(spread(UUID(int=1), "sighting", {"tag": "V-7"}).values())
        ['V-7']
    """
    if not isinstance(value, Mapping):
        return {(device_id, status): value}
    return {(device_id, f"{status}.{field}"): part for field, part in value.items()}


def evaluate(condition: Condition, now: Readings, before: Readings) -> ConditionResult:
    """Judge one condition on fresh readings; a missing reading is UNOBSERVABLE."""
    key = (condition.device_id, condition.status)
    if key not in now or now[key] is None:
        return ConditionResult(
            name=condition.name,
            verdict=ConditionVerdict.UNOBSERVABLE,
            message=f"{spoken_name(condition.status)} could not be read",
        )
    value = now[key]
    evidence: dict[str, Any] = {"status": condition.status, "value": value}
    doubt = _doubt(condition, now, evidence)
    if doubt:
        return ConditionResult(
            name=condition.name,
            verdict=ConditionVerdict.UNOBSERVABLE,
            message=doubt,
            evidence=evidence,
        )
    holds, wanted = _compare(condition, value, before.get(key))
    evidence["wanted"] = wanted
    name, lacks = spoken_name(condition.status), lacks_baseline(condition, before)
    if condition.change is not None:
        evidence["before"] = before.get(key)
    if holds is None or lacks:
        verdict, text = (
            ConditionVerdict.UNOBSERVABLE,
            lacks or f"{name} was not read before the start",
        )
    else:
        verdict = ConditionVerdict.PASS if holds else ConditionVerdict.FAIL
        text = f"{name}: {spoken_value(condition.status, value)}, wanted {_told(condition)}"
    return ConditionResult(name=condition.name, verdict=verdict, message=text, evidence=evidence)


def lacks_baseline(condition: Condition, before: Readings) -> str:
    """Say why a change cannot be told from the readings before the start; empty: it can.

    Args:
        condition: A post-condition; only one that wants a change has to be read before.
        before: Readings from just before the start.
    """
    if condition.change is None:
        return ""
    device, name = condition.device_id, spoken_name(condition.status)
    if _number(before.get((device, condition.status))) is None:
        return f"{name} was not read before the start"
    stable = condition.stable_status
    if stable is not None and before.get((device, stable)) is not True:
        return f"{name} had not settled before the start"
    return ""


def unreadable_baselines(post: Sequence[Condition], before: Readings) -> list[ConditionResult]:
    """Return the changes that nobody could confirm afterwards, since nothing can be read before.

    An action with such a one is not begun, unless its step lets it stay unconfirmed. A reading
    that is there and has not settled may still settle: it is judged after the action.
    """
    return [
        ConditionResult(
            name=condition.name,
            verdict=ConditionVerdict.UNOBSERVABLE,
            message=f"{spoken_name(condition.status)} could not be read before the start, so "
            "nothing could be confirmed afterwards: the action was not begun",
        )
        for condition in post
        if condition.change is not None
        and not condition.may_stay_unconfirmed
        and before.get((condition.device_id, condition.status)) is None
    ]


def statuses_of(condition: Condition) -> tuple[str, ...]:
    """Return every status of the device that has to be read to judge a condition."""
    names = (
        condition.status,
        condition.stable_status,
        condition.confidence_status,
        condition.image_status,
    )
    return tuple(name for name in names if name is not None)


def _doubt(condition: Condition, now: Readings, evidence: dict[str, Any]) -> str:
    """Say why a reading tells nothing, and keep as evidence what came with it."""
    device = condition.device_id
    if (
        condition.stable_status is not None
        and now.get((device, condition.stable_status)) is not True
    ):
        return f"{spoken_name(condition.status)} has not settled"
    if condition.image_status is not None:
        image = now.get((device, condition.image_status))
        if not isinstance(image, str) or not _SHA256.fullmatch(image):
            return f"no image of {spoken_name(condition.status)} was kept"
        evidence |= {"image_sha256": image, "camera_id": str(device)}
    if condition.confidence_status is not None:
        confidence = _number(now.get((device, condition.confidence_status)))
        if confidence is None or not 0 <= confidence <= 1:
            return f"nobody says how sure {spoken_name(condition.status)} is"
        evidence |= {"confidence": confidence, "min_confidence": condition.min_confidence}
        if confidence < condition.min_confidence:
            wanted = f"{condition.min_confidence:.0%} wanted"
            return f"{spoken_name(condition.status)} is {confidence:.0%} sure, {wanted}"
    if condition.equals is None and _number(now[device, condition.status]) is None:
        return f"{spoken_name(condition.status)} is no number"
    return ""


_SHA256 = re.compile(r"[0-9a-f]{64}")


def _number(value: Any) -> float | None:  # noqa: ANN401 - hostile until parsed
    """Return a finite number; a text, a truth value or NaN is none."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _compare(condition: Condition, value: Any, before: Any) -> tuple[bool | None, str]:  # noqa: ANN401
    if condition.equals is not None:
        is_same_sort = isinstance(value, bool) == isinstance(condition.equals, bool)
        return is_same_sort and value == condition.equals, f"{condition.equals}"
    number = float(value)
    if condition.change is not None:
        wanted = f"a change of {condition.change:g} ± {condition.tolerance:g}"
        first = _number(before)
        if first is None:
            return None, wanted
        return abs(number - first - condition.change) <= condition.tolerance, wanted
    low = -float("inf") if condition.low is None else condition.low - condition.tolerance
    high = float("inf") if condition.high is None else condition.high + condition.tolerance
    return low <= number <= high, f"{condition.low} to {condition.high}"


def _told(condition: Condition) -> str:
    """Say what is wanted as a person reads it."""
    name = condition.status
    if condition.equals is not None:
        return spoken_value(name, condition.equals)
    if condition.change is not None:
        change, tolerance = spoken_value(name, condition.change), condition.tolerance
        return f"a change of {change} ± {spoken_value(name, tolerance)}"
    low, high = condition.low, condition.high
    if low is None and high is None:
        return "a number"
    if low is None:
        return f"at most {spoken_value(name, high)}"
    if high is None:
        return f"at least {spoken_value(name, low)}"
    return f"{low:g} to {spoken_value(name, high)}" if low != high else spoken_value(name, low)


def verification_of(
    post: Sequence[tuple[Condition, ConditionResult]], *, reported: bool
) -> Verification:
    """Return the surest verification that the conditions support.

    One that may stay unconfirmed and could not be observed leaves the whole unconfirmed,
    whatever the others say.
    """
    if any(
        one.may_stay_unconfirmed and r.verdict is ConditionVerdict.UNOBSERVABLE for one, r in post
    ):
        return Verification.UNCONFIRMED
    passed = [condition for condition, result in post if result.verdict is ConditionVerdict.PASS]
    if any(condition.is_sensor for condition in passed):
        return Verification.SENSED
    if passed or reported:
        return Verification.DEVICE
    return Verification.ASSUMED
