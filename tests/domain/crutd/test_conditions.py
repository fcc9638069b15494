"""A condition passes, fails, or nobody could look; the last is never taken for the first."""

from __future__ import annotations

from typing import Any
from uuid import UUID

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labweb.domain.crutd.pre_and_postconditions import (
    Condition,
    ConditionVerdict,
    Verification,
    evaluate,
    sees_tag,
    sees_vessel,
    spread,
    statuses_of,
    verification_of,
)

CAMERA = UUID(int=1)
IMAGE = "ab" * 32


def readings(**values: Any) -> dict[tuple[UUID, str], Any]:  # noqa: ANN401
    return {(CAMERA, name): value for name, value in values.items()}


def vial_seen(**fields: Any) -> Condition:  # noqa: ANN401
    plain: dict[str, Any] = {
        "name": "camera.vial_present", "device_id": CAMERA, "status": "tag", "equals": "VIAL-7",
        "confidence_status": "confidence", "min_confidence": 0.9, "image_status": "image_sha256",
        "is_sensor": True,
    }  # fmt: skip
    return Condition(**plain | fields)


def test_a_camera_that_is_sure_confirms_and_keeps_its_image() -> None:
    now = readings(tag="VIAL-7", confidence=0.97, image_sha256=IMAGE)
    result = evaluate(vial_seen(), now, {})
    assert result.verdict is ConditionVerdict.PASS
    assert result.evidence == {
        "status": "tag", "value": "VIAL-7", "wanted": "VIAL-7", "image_sha256": IMAGE,
        "camera_id": str(CAMERA), "confidence": 0.97, "min_confidence": 0.9,
    }  # fmt: skip
    assert verification_of([(vial_seen(), result)], reported=True) is Verification.SENSED


def test_a_camera_that_sees_another_tag_refuses() -> None:
    now = readings(tag="VIAL-8", confidence=0.97, image_sha256=IMAGE)
    assert evaluate(vial_seen(), now, {}).verdict is ConditionVerdict.FAIL


@pytest.mark.parametrize(
    "values",
    [
        {"confidence": 0.89},
        {"confidence": None},
        {"confidence": "high"},
        {"confidence": float("nan")},
        {"confidence": 97},
        {"confidence": True},
        {"image_sha256": None},
        {"image_sha256": "photo.jpg"},
        {"tag": None},
    ],
)
def test_a_camera_that_is_not_sure_or_kept_no_image_saw_nothing(values: dict[str, Any]) -> None:
    now = readings(**{"tag": "VIAL-7", "confidence": 0.97, "image_sha256": IMAGE} | values)
    result = evaluate(vial_seen(), now, {})
    assert result.verdict is ConditionVerdict.UNOBSERVABLE
    assert verification_of([(vial_seen(), result)], reported=True) is Verification.DEVICE
    assert verification_of([(vial_seen(), result)], reported=False) is Verification.ASSUMED


def test_every_status_that_a_verdict_needs_is_read() -> None:
    assert statuses_of(vial_seen()) == ("tag", "confidence", "image_sha256")
    assert statuses_of(vial_seen(stable_status="steady"))[1] == "steady"


SIGHTING = {
    "is_present": True, "presence_confidence_ratio": 0.95, "tag": "VIAL-7",
    "tag_confidence_ratio": 0.95, "image_sha256": IMAGE,
}  # fmt: skip


@pytest.mark.parametrize(
    ("fields", "verdict"),
    [
        ({}, ConditionVerdict.PASS),
        ({"tag": "VIAL-8"}, ConditionVerdict.FAIL),
        ({"tag": ""}, ConditionVerdict.FAIL),
        ({"tag": None}, ConditionVerdict.UNOBSERVABLE),
        ({"tag_confidence_ratio": 0.89}, ConditionVerdict.UNOBSERVABLE),
        ({"tag": "VIAL-8", "tag_confidence_ratio": 0.89}, ConditionVerdict.UNOBSERVABLE),
        ({"image_sha256": None}, ConditionVerdict.UNOBSERVABLE),
    ],
)
def test_one_sighting_tells_tag_confidence_and_image_together(
    fields: dict[str, Any], verdict: ConditionVerdict
) -> None:
    now = spread(CAMERA, "sighting", SIGHTING | fields)
    assert evaluate(sees_tag(CAMERA, "VIAL-7", min_confidence=0.9), now, {}).verdict is verdict


def test_an_empty_place_has_to_be_seen() -> None:
    empty = sees_vessel(CAMERA, is_present=False, min_confidence=0.9)
    for is_present, sure, verdict in [
        (False, 0.95, ConditionVerdict.PASS),
        (True, 0.95, ConditionVerdict.FAIL),
        (None, 0.0, ConditionVerdict.UNOBSERVABLE),
        (False, 0.5, ConditionVerdict.UNOBSERVABLE),
    ]:
        fields = {"is_present": is_present, "presence_confidence_ratio": sure}
        assert evaluate(empty, spread(CAMERA, "sighting", SIGHTING | fields), {}).verdict is verdict
    assert evaluate(empty, {}, {}).verdict is ConditionVerdict.UNOBSERVABLE


def limits(**fields: Any) -> Condition:  # noqa: ANN401
    return Condition(name="c", device_id=CAMERA, status="value", **fields)


@pytest.mark.parametrize(
    ("condition", "value", "verdict"),
    [
        (limits(low=1, high=2), 2.0, ConditionVerdict.PASS),
        (limits(low=1, high=2, tolerance=0.5), 2.5, ConditionVerdict.PASS),
        (limits(low=1, high=2), 2.1, ConditionVerdict.FAIL),
        (limits(low=1), "2", ConditionVerdict.UNOBSERVABLE),
        (limits(low=1), float("nan"), ConditionVerdict.UNOBSERVABLE),
        (limits(high=1), float("-inf"), ConditionVerdict.UNOBSERVABLE),
        (limits(low=1), True, ConditionVerdict.UNOBSERVABLE),
        (limits(equals=1), True, ConditionVerdict.FAIL),
        (limits(equals=True), 1, ConditionVerdict.FAIL),
        (limits(equals=False), False, ConditionVerdict.PASS),
        (limits(change=5, tolerance=1), 15.5, ConditionVerdict.PASS),
        (limits(change=5, tolerance=1), 16.5, ConditionVerdict.FAIL),
    ],
)
def test_a_reading_is_judged_by_what_it_is(
    condition: Condition, value: object, verdict: ConditionVerdict
) -> None:
    assert evaluate(condition, readings(value=value), readings(value=10.0)).verdict is verdict


@pytest.mark.parametrize("before", [None, "ten", float("nan")])
def test_a_change_from_nothing_known_is_unobservable(before: object) -> None:
    result = evaluate(limits(change=5), readings(value=15.0), readings(value=before))
    assert result.verdict is ConditionVerdict.UNOBSERVABLE


JSON = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.lists(st.integers())


@given(JSON, JSON, JSON, st.sampled_from([limits(low=0), limits(change=1), vial_seen()]))
def test_whatever_is_read_there_is_a_verdict(
    value: object, other: object, before: object, condition: Condition
) -> None:
    now = readings(value=value, tag=value, confidence=other, image_sha256=other)
    result = evaluate(condition, now, readings(value=before))
    if result.verdict is ConditionVerdict.PASS:
        assert isinstance(value, int | float)


@pytest.mark.parametrize(
    ("status", "wanted", "value", "told"),
    [
        ("is_initialized", {"equals": True}, False, "initialized: no, wanted yes"),
        ("port_index", {"equals": 1}, 2, "port: 2, wanted 1"),
        ("tag", {"equals": "VIAL_7"}, "VIAL_8", "tag: VIAL_8, wanted VIAL_7"),
        ("volume_ul", {"low": 0.0, "high": 0.0}, 2000.0, "volume: 2000 µL, wanted 0 µL"),
        ("plate_temperature_c", {"low": 20.0, "high": 25.0}, 60.0,
         "plate temperature: 60 °C, wanted 20 to 25 °C"),
        ("mass_mg", {"low": 5.0}, 1.0, "mass: 1 mg, wanted at least 5 mg"),
        ("mass_mg", {"high": 5.0}, 9.0, "mass: 9 mg, wanted at most 5 mg"),
    ],
)  # fmt: skip
def test_a_condition_that_fails_is_told_in_words(
    status: str, wanted: dict[str, Any], value: float | str, told: str
) -> None:
    condition = Condition(name="a.b", device_id=CAMERA, status=status, **wanted)
    assert evaluate(condition, readings(**{status: value}), {}).message == told
