"""Plans that do not do as they claim, each with the code of the rule it breaks."""

from __future__ import annotations

from typing import Any

from tests.domain.proof import plans as right
from tests.domain.proof.bench import (
    act,
    by_hand,
    carry,
    draw,
    plan,
    port,
    shift,
    step,
)
from tests.domain.proof.wrong_strokes import HALF_FULL, move, of_step, with_fields

WATER = right.WATER
SHARED = right.RIGHT["shared vacuum"]
STEPS = (right.VACUUM_BOTH, right.WAIT, right.VENT_BOTH)
VACUUM_BOTH, VENT_BOTH = right.VACUUM_BOTH["does"], right.VENT_BOTH["does"]


def seen(**found: object) -> dict[str, Any]:
    groups = [[by_hand("check", **found)], *right.EVAPORATE["actions"]]
    return {"does": right.EVAPORATE["does"], "actions": groups}


def twice(right_step: dict[str, Any], **first: object) -> dict[str, Any]:
    """The same step, which does something else before."""
    (action,) = right_step["actions"][-1]
    other = {**action, "parameters": {**action["parameters"], **first}}
    return {**right_step, "actions": [[other], *right_step["actions"]]}


def opening(right_step: dict[str, Any]) -> dict[str, Any]:
    """The same step, which opens a solenoid that nothing goes through."""
    return {**right_step, "actions": [[act("solenoid open")], *right_step["actions"]]}


def reach(low_c: float, high_c: float) -> dict[str, Any]:
    groups = [[act("hotplate await_temperature", low_c=low_c, high_c=high_c)]]
    return step("reach", groups, vessel="reactor", low_c=low_c, high_c=high_c)


def lit(*wavelengths_nm: float, **claim: object) -> dict[str, Any]:
    groups = [[act("lamp start_light", wavelength_nm=one)] for one in wavelengths_nm]
    return step("light", groups, vessel="reactor", **claim)


def flush(port_name: str, target: str) -> dict[str, Any]:
    groups = carry("2", port_name, 5_000)
    return step("flush", groups, from_="flask_n2", to=target, volume_ul=5_000)


HOT = reach(300, 320)
VACUUM_AFTER_WATER = plan(right.TO_REACTOR, right.VACUUM, right.VENT, flask_water=WATER)
WRONG: list[tuple[str, dict[str, Any]]] = [
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
    ("claim", plan(lit(450, 365), right.STOP_LIGHT)),
    ("claim", plan(lit(365, wavelength_nm=450), right.STOP_LIGHT)),
    ("claim", plan(lit(450, color="blue"), right.STOP_LIGHT)),
    ("claim", plan(lit(wavelength_nm=450), right.STOP_LIGHT)),
    ("claim", plan(flush("0", "reactor"))),
    ("never_reached", plan(HOT)),
    ("never_reached", plan(right.HEAT, right.STOP_HEAT, HOT)),
    ("never_reached", plan(reach(2, 14))),
    ("never_reached", plan(right.HEAT, right.REACH, right.STOP_HEAT, reach(30, 40), reach(45, 55))),
    ("never_reached", plan(right.HEAT, reach(20, 30), right.STOP_HEAT)),
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
    # flask_g may be on the vacuum before, and is on it after.
    (
        "vacuum_changed",
        plan(step("ask", [[by_hand("check")], [port("valve_g", "0")]], text="please")),
    ),
    # valve_d has not been turned, and may join flask_f to the pump that starts.
    (
        "vacuum_changed",
        plan(
            {"does": VACUUM_BOTH, "actions": right.VACUUM_BOTH["actions"][1:]},
            right.VENT_BOTH,
        ),
    ),
    ("vacuum_changed", of_step(SHARED, 0, does=VACUUM_BOTH | {"also": []})),
    ("vacuum_changed", of_step(SHARED, 2, does=VENT_BOTH | {"also": []})),
    ("vacuum_on", plan(right.VACUUM, right.ADD_SOLID, right.VENT)),
    ("vacuum_shared", plan(*STEPS, flask_e={"solid_salt": 1.0})),
    ("claim", of_step(SHARED, 0, does=VACUUM_BOTH | {"also": ["flask_e", "reactor"]})),
    ("claim", of_step(SHARED, 0, does=VACUUM_BOTH | {"also": ["flask_e", "flask_d"]})),
    ("claim", of_step(SHARED, 2, does=VENT_BOTH | {"also": ["flask_e", "reactor"]})),
    ("unknown_vessel", of_step(SHARED, 0, does=VACUUM_BOTH | {"also": ["flask_e", "line"]})),
    ("dry_draw", plan(right.SEEN, rotavap={"ether": 3_999.0})),
    ("may_overflow", plan(seen(vessel="rotavap", least_ul=5), rotavap=HALF_FULL)),
    ("unknown_vessel", plan(seen(vessel="line", least_ul=5))),
    ("shape", plan(seen(vessel="rotavap"))),
    ("shape", plan(seen(least_ul=5))),
    ("off_grid", plan(seen(vessel="rotavap", least_ul=0.0001))),
    ("solenoid_open", plan(opening(right.WAIT))),
    ("solenoid_open", plan(opening(right.TO_REACTOR), flask_water=WATER)),
    (
        "device_twice",
        plan(step("wait", [[act("@timer wait", duration_s=30)] * 2], duration_s=60)),
    ),
    ("claim", plan(twice(right.HEAT, temperature_c=200), right.STOP_HEAT)),
    ("claim", plan(twice(right.STIR, speed_rpm=2_000), right.STOP_STIR)),
    ("claim", plan(twice(right.ROTATE, speed_rpm=280), right.STOP_ROTATE)),
    ("claim", plan(twice(right.VACUUM_R, pressure_mbar=1), right.VENT_R)),
    ("claim", plan(right.HEAT, twice(right.REACH, high_c=90, low_c=0), right.STOP_HEAT)),
    ("unordered", of_step(VACUUM_AFTER_WATER, 1, after=[])),
    ("unordered", of_step(plan(right.ADD_SOLID, right.GAS, right.STOP_GAS), 1, after=[])),
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
