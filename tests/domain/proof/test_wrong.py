"""Wrong plans: each breaks one rule, and is refused by the code of that rule."""

from __future__ import annotations

import json
from typing import Any

import pytest

from labweb.domain.errors import LabFileError, ProtocolError
from labweb.domain.proof.plan_read import parse_plan
from tests.domain.proof import plans as right
from tests.domain.proof import wrong_claims, wrong_strokes
from tests.domain.proof.bench import (
    act,
    by_hand,
    codes,
    draw,
    plan,
    step,
)
from tests.domain.proof.wrong_strokes import HALF_FULL, with_fields

WATER = right.WATER


WRONG = wrong_strokes.WRONG + wrong_claims.WRONG


@pytest.mark.parametrize(
    ("code", "wrong"), WRONG, ids=[f"{i} {c}" for i, (c, _) in enumerate(WRONG)]
)
def test_a_wrong_plan_is_refused_by_its_code(code: str, wrong: dict[str, Any]) -> None:
    try:
        found = codes(wrong)
    except ProtocolError as error:
        found = {finding.code for finding in error.findings}
    assert f"interpret.{code}" in found


def test_right_totals_are_proved() -> None:
    totals = {
        "duration_s": 1.0,
        "critical_path_s": 1.0,
        "by_hand_count": 0,
        "delivered_ul": {"reactor": {"water": 16_000.0}},
        "delivered_ug": {},
    }
    bindings = {"reagents": {"water": "flask_water"}}
    assert not codes(with_fields(right.RIGHT["transfer"], totals=totals, bindings=bindings))


def test_a_check_by_hand_lets_a_vessel_be_filled_that_may_overflow() -> None:
    groups = [[by_hand("check")], *right.EVAPORATE["actions"]]
    asked = step("evaporate", groups, **right.EVAPORATE["does"])
    assert "interpret.may_overflow" in codes(plan(right.EVAPORATE, rotavap=HALF_FULL))
    assert not codes(plan(asked, rotavap=HALF_FULL))


@pytest.mark.parametrize(
    "fields",
    [
        {"more": 1},
        {"plan": 2},
        {"plan": True},
        {"steps": {}},
        {"steps": [5, {}]},
        {"notes": [5]},
        {"contents": {"reactor": [{"lot": "a", "phase": "liquid", "volume_ul": -1}]}},
        {"contents": {"reactor": [{"lot": "a", "phase": "liquid", "mass_ug": 1}]}},
        {"contents": {"reactor": [{"lot": "a", "phase": "solid", "mass_ug": "1"}]}},
        {"capacities_ul": {"reactor": 0}},
        {"graph_sha256": "abc"},
    ],
)
def test_a_plan_of_the_wrong_form_is_refused(fields: dict[str, Any]) -> None:
    raw = json.dumps(with_fields(right.RIGHT["gas"], **fields)).encode()
    with pytest.raises(ProtocolError) as error:
        parse_plan(raw)
    assert {finding.code for finding in error.value.findings} == {"interpret.shape"}


def test_every_wrong_action_and_claim_is_named() -> None:
    groups: list[Any] = [[draw("pump_1", -1), {"device": "x"}], 5]
    wrong = plan(
        step("transfer", groups, to="waste"),
        step("dance", [[act("pump_1 dispense", volume_ul=True, rate_ul_s=1)]]),
        step("stir", [], vessel="reactor", speed_rpm=4, to="waste"),
        step("stir", [], vessel=["reactor"], speed_rpm=4),
    )
    with pytest.raises(ProtocolError) as error:
        parse_plan(json.dumps(wrong).encode())
    assert len(error.value.findings) == 8


@pytest.mark.parametrize(
    ("raw", "code"),
    [
        (b"", "lab_file.json"),
        (b"[" * 100_000, "lab_file.depth"),
        (b'{"plan": NaN}', "lab_file.number"),
        (b'{"plan": 1e999}', "lab_file.number"),
        (b'{"plan": 1, "plan": 1}', "lab_file.duplicate_key"),
        (b"\xff", "lab_file.encoding"),
        (b" " * (50 * 1024 * 1024), "lab_file.too_large"),
    ],
)
def test_a_hostile_file_is_refused(raw: bytes, code: str) -> None:
    with pytest.raises(LabFileError) as error:
        parse_plan(raw)
    assert [finding.code for finding in error.value.findings] == [code]
