"""What a look proves, and what it does not."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.enrollment.device_look import judge_look
from labweb.domain.enrollment.driver_spec import DriverSpec, ParameterSpec, StatusSpec

SPEC = DriverSpec(
    class_name="Probe",
    module="m",
    digest="",
    statuses=(
        StatusSpec(
            name="temperature_c",
            value=ParameterSpec(
                name="temperature_c", type="number", unit="c", minimum=-50.0, maximum=300.0
            ),
        ),
        StatusSpec(name="is_on", value=ParameterSpec(name="is_on", type="boolean")),
    ),
)
GOOD: dict[str, Any] = {
    "problem": "",
    "values": {"temperature_c": 21.5, "is_on": False},
    "problems": {},
    "took_s": 0.4,
    "skew_s": 0.01,
}


def failed(**changes: Any) -> list[str]:  # noqa: ANN401 - fields of a look
    return [one.name for one in judge_look(SPEC, **GOOD | changes) if not one.is_passed]


def test_a_device_that_answers_tells_all_and_is_fast_has_passed() -> None:
    assert failed() == []
    assert len(judge_look(SPEC, **GOOD)) == 4


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"problem": "a Julabo answers"}, "who answers"),
        ({"values": {"temperature_c": 21.5}}, "what it tells"),
        ({"values": {"temperature_c": 301.0, "is_on": True}}, "what it tells"),
        ({"values": {"temperature_c": float("nan"), "is_on": True}}, "what it tells"),
        ({"values": {"temperature_c": 21.5, "is_on": "yes"}}, "what it tells"),
        ({"problems": {"is_on": "it did not answer"}}, "what it tells"),
        ({"took_s": 10.1}, "how fast"),
        ({"skew_s": -3.9}, "clock of the host"),
        ({"skew_s": None}, "clock of the host"),
    ],
)
def test_what_is_not_proved_is_named(changes: dict[str, Any], name: str) -> None:
    assert failed(**changes) == [name]


def test_where_another_device_answers_nothing_else_is_claimed() -> None:
    (check,) = judge_look(SPEC, **GOOD | {"problem": "a Julabo answers"})
    assert check.text == "a Julabo answers"
