"""Wrong plans: each breaks one rule, and is refused by the code of that rule."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest

from labweb.domain.errors import LabFileError, ProtocolError
from labweb.domain.workflows.interpret.plan import parse_plan
from tests.domain.workflows.interpret import plans as right
from tests.domain.workflows.interpret.bench import (
    act,
    by_hand,
    carry,
    codes,
    draw,
    plan,
    port,
    push,
    shift,
    step,
)

WATER = right.WATER


def move(groups: list[Any], **more: Any) -> dict[str, Any]:  # noqa: ANN401 - fields of a claim
    claim = {"from": "flask_water", "to": "reactor", "volume_ul": 5_000, **more}
    return plan(step("transfer", groups, **claim), flask_water=WATER)


def with_fields(base: dict[str, Any], **fields: object) -> dict[str, Any]:
    return copy.deepcopy(base) | fields


def of_step(base: dict[str, Any], number: int, **fields: object) -> dict[str, Any]:
    changed = copy.deepcopy(base)
    changed["steps"][number] |= fields
    return changed


HALF_FULL = {"ether": 60_000.0}
BOILED = plan(right.EVAPORATE, right.EVAPORATE, rotavap={"ether": 40_000.0})
WRONG: list[tuple[str, dict[str, Any]]] = [
    ("order", of_step(right.RIGHT["gas"], 1, id=7)),
    ("order", of_step(right.RIGHT["gas"], 1, after=[2])),
    ("unordered", of_step(right.RIGHT["gas"], 1, after=[])),
    ("off_grid", move(carry("0", "0", 0.0001))),
    ("other_graph", with_fields(right.RIGHT["gas"], graph_sha256="1" * 64)),
    ("capacity", with_fields(right.RIGHT["gas"], capacities_ul={"reactor": 100_001.0})),
    ("unknown_device", move([[port("valve_9", "0")]])),
    ("unknown_action", move([[act("valve_1 stir", speed_rpm=4)]])),
    ("unknown_action", move([[act("valve_1 jump")]])),
    ("unknown_vessel", move(carry("0", "0", 5_000), to="valve_1")),
    ("unknown_vessel", with_fields(right.RIGHT["gas"], capacities_ul={"nowhere": 5.0})),
    ("unknown_vessel", with_fields(right.RIGHT["gas"], bindings={"reagents": {"x": "nowhere"}})),
    ("unknown_port", move([[port("valve_1", "6")]])),
    ("unknown_port", move([[port("valve_1", "-1")]])),
    ("device_twice", move([[port("valve_1", "0"), port("valve_1", "1")]])),
    ("device_twice", move([[port("valve_1", "0")], [draw("pump_1", 5), draw("pump_1", 5)]])),
    (
        "turned_while_moving",
        move([[port("valve_1", "0")], [draw("pump_1", 5), port("valve_2", "1")]]),
    ),
    ("valve_unset", move([[draw("pump_1", 5_000)]])),
    (
        "valve_unset",
        plan(
            right.CLEAN,
            step(
                "transfer",
                [[draw("pump_2", 1)]],
                **{"from": "waste", "to": "reactor", "volume_ul": 1},
            ),
            flask_water=WATER,
        ),
    ),
    ("no_path", move([[port("valve_1", "5")], [draw("pump_1", 5)]])),
    ("no_path", move([[port("valve_1", "3"), port("valve_2", "3")], [draw("pump_1", 5)]])),
    ("divides", move([[port("valve_3", "0")], [draw("pump_3", 5)]])),
    ("no_vessel", move([[port("valve_3", "1")], [draw("pump_3", 5)]])),
    (
        "no_vessel",
        move(
            [
                [port("valve_1", "0")],
                [draw("pump_1", 5)],
                [port("valve_1", "2")],
                [push("pump_1", 5)],
            ]
        ),
    ),
    ("unknown_syringe", move([[port("valve_3", "2")], [draw("pump_3", 5)]])),
    (
        "crossing",
        move(
            [
                [port("valve_1", "4"), port("valve_3", "3")],
                [push("pump_1", 5), push("pump_3", 5)],
            ]
        ),
    ),
    (
        "unequal_pass",
        move(
            [[port("valve_1", "3"), port("valve_2", "4")], [draw("pump_1", 5), push("pump_2", 4)]]
        ),
    ),
    ("unequal_pass", move([[port("valve_1", "3"), port("valve_2", "4")], [draw("pump_1", 5)]])),
    (
        "both_ways",
        move(
            [
                [port("valve_2", "0"), port("valve_3", "4")],
                [push("pump_2", 5), draw("pump_3", 5)],
            ]
        ),
    ),
    (
        "meets",
        move(
            [
                [port("valve_1", "0")],
                [draw("pump_1", 5)],
                [port("valve_1", "1")],
                [draw("pump_1", 5)],
            ]
        ),
    ),
    ("overfull", move([[port("valve_1", "0")], [draw("pump_1", 10_001)]])),
    ("pushes_more", move([[port("valve_1", "0")], [draw("pump_1", 5)], [push("pump_1", 6)]])),
    ("dry_draw", plan(right.TO_REACTOR, flask_water={"water": 15_999.999})),
    (
        "dry_draw",
        plan(
            right.SEPARATE,
            step(
                "transfer", shift("2", "0", 1), **{"from": "waste", "to": "reactor", "volume_ul": 1}
            ),
            separator={"water": 20_000.0},
        ),
    ),
    (
        "not_watched",
        plan(step("separate", right.SEPARATE["actions"][1:], **right.SEPARATE["does"])),
    ),
    ("overflow", plan(right.TO_REACTOR, flask_water=WATER, reactor={"ether": 84_000.001})),
    ("overflow", plan(right.ASK, reactor={"ether": 100_000.001})),
    (
        "overflow",
        plan(
            step(
                "fill",
                [[by_hand("fill", vessel="reactor", lot="a", volume_ul=1)]],
                to="reactor",
                lot="a",
                volume_ul=1,
            ),
            reactor={"ether": 100_000.0},
        ),
    ),
    ("may_overflow", plan(right.EVAPORATE, rotavap=HALF_FULL)),
    ("vacuum_on", plan(right.VACUUM, right.TO_REACTOR, right.VENT, flask_water=WATER)),
    (
        "vacuum_on",
        plan(
            right.VACUUM,
            step(
                "vent",
                [[act("cvc vent")], [act("cvc stop_vacuum")], [port("valve_vac", "5")]],
                vessel="reactor",
            ),
        ),
    ),
    (
        "never_reached",
        plan(
            right.HEAT,
            step(
                "reach",
                [[act("hotplate await_temperature", low_c=70, high_c=80)]],
                vessel="reactor",
                low_c=70,
                high_c=80,
            ),
            right.STOP_HEAT,
        ),
    ),
    ("syringe_not_empty", move([[port("valve_1", "0")], [draw("pump_1", 5_000)]])),
    (
        "solenoid_open",
        plan(
            step(
                "transfer",
                [g for g in right.SOLENOID["actions"] if g[0]["action"] != "close"],
                **right.SOLENOID["does"],
            ),
            flask_empty=WATER,
        ),
    ),
    ("through", move(right.THROUGH["actions"], to="filter")),
    ("through", move(carry("0", "0", 5_000), through=["cartridge"])),
    ("claim", move(carry("0", "0", 5_000), to="waste")),
    ("claim", move(carry("0", "0", 5_000), volume_ul=5_000.001)),
    ("claim", move(carry("0", "0", 5_000), lot="ether")),
    ("claim", plan(right.TO_REACTOR, flask_water={"water": 20_000.0, "ether": 20_000.0})),
    (
        "claim",
        plan(
            step(
                "transfer",
                shift("0", "2", 8_000, until="empty"),
                **{"from": "reactor", "to": "waste", "all": True, "most_ul": 16_000},
            ),
            reactor={"water": 16_000.0},
        ),
    ),
    (
        "claim",
        plan(
            step(
                "transfer",
                shift("0", "2", 10_000, 10_000, until="empty"),
                **{"from": "reactor", "to": "waste", "all": True, "most_ul": 15_000},
            ),
            reactor={"water": 16_000.0},
        ),
    ),
    (
        "claim",
        plan(
            step(
                "separate",
                [
                    right.SEPARATE["actions"][0],
                    *shift("3", "2", 10_000, until="boundary"),
                    *right.SEPARATE["actions"][9:],
                ],
                **right.SEPARATE["does"],
            ),
            separator={"water": 20_000.0},
        ),
    ),
    (
        "claim",
        of_step(
            right.RIGHT["separate"],
            0,
            does=right.SEPARATE["does"] | {"upper_to": "waste", "lower_to": "reactor"},
        ),
    ),
    (
        "claim",
        plan(
            step("stir", [[act("hotplate stir", speed_rpm=300)]], vessel="reactor", speed_rpm=400),
            right.STOP_STIR,
        ),
    ),
    ("claim", plan(step("wait", [[act("@timer wait", duration_s=59)]], duration_s=60))),
    ("claim", plan(step("vacuum", [[act("cvc start_vacuum")]], vessel="reactor"), right.VENT)),
    (
        "unclaimed",
        plan(step("ask", [[by_hand("check")], [act("@timer wait", duration_s=5)]], text="please")),
    ),
    (
        "unclaimed",
        plan(
            step(
                "stir",
                [[act("hotplate stir", speed_rpm=4)], [act("stirrer stir", speed_rpm=4)]],
                vessel="reactor",
                speed_rpm=4,
            ),
            right.STOP_STIR,
        ),
    ),
    ("unclaimed", move([*carry("0", "0", 5_000), *carry("2", "2", 5_000)])),
    (
        "unclaimed",
        plan(
            step("ask", [[by_hand("check")], *carry("0", "0", 5)], text="please"), flask_water=WATER
        ),
    ),
    (
        "gas_changed",
        plan(right.GAS, step("ask", [[by_hand("check")], [port("valve_vac", "5")]], text="please")),
    ),
    (
        "vacuum_changed",
        plan(
            right.VACUUM,
            step("ask", [[by_hand("check")], [port("valve_vac", "5")]], text="please"),
            right.VENT,
        ),
    ),
    ("left_running", plan(right.STIR)),
    ("left_running", plan(right.HEAT)),
    ("left_running", plan(right.VACUUM)),
    ("left_running", plan(right.ROTATE)),
    ("left_running", plan(right.LIGHT)),
    ("left_running", plan(right.GAS)),
    ("totals", with_fields(right.RIGHT["gas"], totals={"duration_s": 3.0})),
    ("totals", with_fields(right.RIGHT["gas"], totals={"critical_path_s": 1.0})),
    ("totals", with_fields(right.RIGHT["by hand"], totals={"by_hand_count": 3})),
    ("totals", with_fields(right.RIGHT["by hand"], totals={"delivered_ug": {}})),
    (
        "totals",
        with_fields(
            right.RIGHT["transfer"],
            bindings={"reagents": {"w": "flask_water"}},
            totals={"delivered_ul": {"reactor": {"water": 1.0}}},
        ),
    ),
]


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
