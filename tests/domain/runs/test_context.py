"""The context of a moment: what is kept, what is cut, and what a host may not smuggle in."""

from __future__ import annotations

from typing import Any
from uuid import UUID

import pytest

from labweb.domain.runs.host_journal.surroundings import MOST_READINGS, context_body, read_context

DEVICE = str(UUID(int=5))


def test_a_context_says_versions_calibration_and_readings_with_their_age() -> None:
    body = context_body(
        "d" * 64,
        {"offset_ph": 0.03, "syringe_ul": 1000.0},
        [(DEVICE, "temperature_c", 21.5, 1.25), (DEVICE, "is_open", False, -0.1)],
    )
    assert body["calibration"] == {"offset_ph": 0.03}
    assert [(r["status"], r["value"], r["age_s"]) for r in body["environment"]] == [
        ("is_open", False, 0.0),
        ("temperature_c", 21.5, 1.25),
    ]
    assert read_context(body) == body


def test_other_settings_have_another_digest_whatever_their_order() -> None:
    first = context_body("d", {"a": 1, "b": 2}, [])["config_digest"]
    assert context_body("d", {"b": 2, "a": 1}, [])["config_digest"] == first
    assert context_body("d", {"a": 1, "b": 3}, [])["config_digest"] != first


def test_the_freshest_readings_are_kept_when_there_are_too_many() -> None:
    many = [(DEVICE, f"s{n:04}", n, float(n)) for n in range(MOST_READINGS + 50)]
    body = context_body("d", {}, many)
    assert len(body["environment"]) == MOST_READINGS
    assert max(r["age_s"] for r in body["environment"]) == MOST_READINGS - 1
    assert read_context(body) == body


def test_a_long_or_nested_value_becomes_a_short_text() -> None:
    body = context_body("d", {}, [(DEVICE, "s", {"deep": ["x" * 999]}, 0.0)])
    assert len(body["environment"][0]["value"]) == 200
    assert read_context(body) == body


@pytest.mark.parametrize(
    "wrong",
    [
        None,
        [],
        {},
        {"driver_digest": "d"},
        {"driver_digest": "d", "config_digest": "c", "secret": 1},
        {"driver_digest": "d" * 999, "config_digest": "c"},
        {"driver_digest": "d", "config_digest": "c", "environment": [{}]},
        {
            "driver_digest": "d",
            "config_digest": "c",
            "environment": [{"device_id": DEVICE, "status": "s", "value": 1, "age_s": -1.0}],
        },
        {
            "driver_digest": "d",
            "config_digest": "c",
            "environment": [{"device_id": "x", "status": "s", "value": 1, "age_s": 1.0}],
        },
    ],
)
def test_what_is_no_context_is_not_kept(wrong: Any) -> None:  # noqa: ANN401
    assert read_context(wrong) is None
