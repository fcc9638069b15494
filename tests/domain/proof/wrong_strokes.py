"""Plans whose form or strokes are wrong, each with the code of the rule it breaks."""

from __future__ import annotations

import copy
from typing import Any

from tests.domain.proof import plans as right
from tests.domain.proof.bench import (
    act,
    carry,
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


def queue(name: str) -> dict[str, str]:
    return {"operation": "Trial", "queue": name}


HELD = plan(right.HEAT, right.WAIT, right.STOP_HEAT)
IN_A_QUEUE = copy.deepcopy(HELD)
for place in range(2):
    IN_A_QUEUE["steps"][place]["of"] = queue("a")
HALF_FULL = {"ether": 60_000.0}
BOILED = plan(right.EVAPORATE, right.EVAPORATE, rotavap={"ether": 40_000.0})
WRONG: list[tuple[str, dict[str, Any]]] = [
    ("order", of_step(right.RIGHT["gas"], 1, id=7)),
    ("order", of_step(right.RIGHT["gas"], 1, after=[2])),
    ("unordered", of_step(right.RIGHT["gas"], 1, after=[])),
    ("unordered", of_step(HELD, 1, after=[])),
    ("unordered", of_step(HELD, 2, after=[1])),
    ("unordered", of_step(plan(right.HEAT, right.ASK, right.STOP_HEAT), 1, after=[])),
    ("unordered", of_step(plan(right.HEAT, right.ASK, right.STOP_HEAT), 2, after=[1])),
    ("unordered", of_step(of_step(HELD, 1, of=queue("a"), after=[]), 2, after=[1, 2])),
    ("unordered", of_step(of_step(HELD, 1, of=queue("a")), 2, after=[1])),
    ("unordered", of_step(HELD, 1, of={"operation": "Trial", "beside": "b"}, after=[])),
    ("unordered", of_step(IN_A_QUEUE, 2, of=queue("a"), after=[1])),
    ("unordered", of_step(IN_A_QUEUE, 1, after=[])),
    ("shape", of_step(right.RIGHT["gas"], 1, after=[0])),
    ("shape", of_step(right.RIGHT["gas"], 1, skip_if=[-1])),
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
]
