"""A synthesis of two steps on a station of four valves: compiled, proved, played."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.domain.recipes.plans import check_claims, check_strokes, claims, compiled, reasons

LAB = Path(__file__).parents[3] / "fixtures/labs/organic_synthesis"
RECIPE = (LAB / "protocols/benzhydryl_acetate.xdl").read_bytes()


def station() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((LAB / "station.json").read_text("utf-8"))
    return found


def test_both_steps_are_compiled_and_proved_in_the_order_of_the_chemistry() -> None:
    plan = compiled(RECIPE, station())
    check_claims(plan)
    assert check_strokes(plan, station()) == 19
    lots = [does["lot"] for does in claims(plan, "transfer") if "lot" in does]
    assert [lot.partition(" in ")[0] for lot in lots] == [
        "tetrahydrofuran",
        "benzaldehyde",
        "1 M phenylmagnesium bromide",
        "saturated aqueous ammonium chloride",
        "diethyl ether",
        "brine",
        "dichloromethane",
        "triethylamine",
        "acetyl chloride",
        "water",
        "dichloromethane",
        "dichloromethane",
    ]
    assert len(claims(plan, "separate")) == 3
    assert len(claims(plan, "evaporate")) == 2
    through = [does["through"] for does in claims(plan, "transfer") if "through" in does]
    assert through == [["cartridge_silica"]] * 3


def test_what_is_parted_is_dried_on_its_way() -> None:
    parted = claims(compiled(RECIPE, station()), "separate")
    dried = [does.get("upper_through") or does.get("lower_through") for does in parted]
    assert dried == [None, ["cartridge_mgso4"], ["cartridge_mgso4"]]


def test_the_grignard_reagent_comes_in_slowly_to_a_cold_flask_under_argon() -> None:
    plan = compiled(RECIPE, station())
    place = next(
        number
        for number, step in enumerate(plan["steps"])
        if "phenylmagnesium" in str(step["does"].get("lot")) and step["does"]["kind"] == "transfer"
    )
    pushes = [
        action["parameters"]["rate_ul_s"]
        for group in plan["steps"][place]["actions"]
        for action in group
        if action["action"] == "dispense"
    ]
    assert pushes[-1] == pytest.approx(16.666667)
    before = [step["does"] for step in plan["steps"][:place]]
    assert [does["temperature_c"] for does in before if does["kind"] == "heat"] == [0.0]
    assert [does["gas"] for does in before if does["kind"] == "gas"] == ["flask_argon"] * 3


@pytest.mark.parametrize(
    ("key", "code"),
    [
        ("cryostat", "plan.no_thermostat"),
        ("stirrer_separator", "plan.no_stirrer"),
        ("cartridge_silica", "plan.no_cartridge"),
        ("flask_argon", "plan.no_gas"),
        ("vacuum_pump_rotavap", "plan.no_vacuum"),
        ("separator", "plan.no_vessel"),
    ],
)
def test_a_part_that_is_missing_is_named(key: str, code: str) -> None:
    graph = station()
    graph["nodes"] = [node for node in graph["nodes"] if node["id"] != key]
    graph["links"] = [n for n in graph["links"] if key not in (n["source"], n["target"])]
    assert code in reasons(RECIPE, graph)
