"""Recipes compiled on a drawn rig.

    water, ether ▸ valve_1 ◂▸ reactor        waste_1
                     ║
                   valve_2 ◂▸ separator, spare flask     waste_2
                     ├▸ filter:top   filter:bottom ▸ valve_2
                                     filter:bottom ◂▸ valve_gas ▸ vacuum | ◂ argon

Each valve has a pump of 25 mL at its common port.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from labweb.domain.recipes.recipe_to_plan import CompileWish
from tests.domain.recipes.plans import (
    bench,
    check_claims,
    check_strokes,
    claims,
    compiled,
    reasons,
    recipe,
)

ROOT = Path(__file__).parents[3]
SEPARATE = (
    'Separate from_vessel="reactor" separation_vessel="separator" to_vessel="filter" '
    'purpose="extract" product_phase="top" solvent="ether" solvent_volume="20 mL" repeats="2"'
)
ADD = 'Add vessel="reactor" reagent="water" volume="60 mL"'


def test_what_is_added_is_filled_in_by_hand_and_reaches_the_vessel() -> None:
    graph = bench()
    plan = compiled(recipe(ADD), graph)
    assert claims(plan) == [
        {"kind": "fill", "to": "flask_water", "lot": "water", "volume_ul": 60000.0},
        {
            "kind": "transfer",
            "from": "flask_water",
            "to": "reactor",
            "volume_ul": 60000.0,
            "lot": "water",
        },
    ]
    assert plan["totals"]["delivered_ul"] == {"reactor": {"water": 60000.0}}
    assert check_strokes(plan, graph) == 1
    check_claims(plan)


def test_the_judge_of_these_tests_sees_a_valve_at_another_port() -> None:
    graph = bench()
    plan = compiled(recipe(ADD), graph)
    turn = next(c for g in plan["steps"][1]["actions"] for c in g if c["action"] == "set_port")
    turn["parameters"]["port"] = "1"
    with pytest.raises(AssertionError):
        check_strokes(plan, graph)


def test_what_the_graph_says_is_in_a_flask_is_not_filled_in_again() -> None:
    graph = bench()
    next(n for n in graph["nodes"] if n["id"] == "flask_water")["current_volume"] = 40
    plan = compiled(recipe(ADD), graph)
    assert claims(plan, "fill")[0]["volume_ul"] == 20000.0
    assert plan["contents"]["flask_water"] == [
        {"lot": "water", "phase": "liquid", "volume_ul": 40000.0}
    ]


def test_a_small_flask_is_filled_again_and_a_small_waste_emptied() -> None:
    graph = bench(flask_water=25, waste_1=40, waste_2=40)
    filter_it = 'Filter vessel="filter"'
    add = 'Add vessel="filter" reagent="water" volume="60 mL"'
    plan = compiled(recipe(add, filter_it), graph)
    assert [does["volume_ul"] for does in claims(plan, "fill")] == [25000.0, 25000.0, 10000.0]
    assert len(claims(plan, "empty")) == 1
    assert claims(plan, "filter")[0]["most_ul"] == 20000.0
    check_claims(plan)
    assert check_strokes(plan, graph) == 5


def test_more_than_a_vessel_holds_is_refused() -> None:
    assert reasons(recipe(ADD), bench(reactor=50)) == ["plan.overflow"]


def test_everything_that_is_missing_is_told_at_once() -> None:
    steps = (
        ADD,
        'Add vessel="reactor" reagent="ethanol" volume="5 mL"',
        'HeatChill vessel="reactor" temp="-78 °C" time="1 h"',
        'Stir vessel="flask_spare" time="1 min"',
        'Evaporate vessel="reactor" time="1 h" pressure="100 mbar"',
        'Transfer from_vessel="reactor" to_vessel="filter" volume="all" through="celite"',
        'Purge vessel="reactor"',
    )
    found = reasons(recipe(*steps, reagents=("water", "ethanol")), bench())
    assert set(found) == {
        "plan.no_reagent",
        "plan.out_of_range",
        "plan.no_stirrer",
        "plan.no_rotavap",
        "plan.no_vacuum",
        "plan.no_cartridge",
        "plan.no_gas",
    }


def test_what_only_follows_from_another_want_is_not_told() -> None:
    steps = (
        'Add vessel="reactor" reagent="ethanol" volume="5 mL"',
        'Transfer from_vessel="reactor" to_vessel="separator" volume="all"',
        SEPARATE,
        'Filter vessel="filter"',
    )
    found = reasons(recipe(*steps, reagents=("water", "ethanol", "ether")), bench())
    assert found == ["plan.no_reagent"]


def test_a_reagent_is_never_taken_from_a_flask_of_a_like_name() -> None:
    text = recipe('Add vessel="reactor" reagent="Water" volume="5 mL"', reagents=("Water",))
    assert reasons(text, bench()) == ["plan.no_reagent"]
    plan = compiled(text, bench(), CompileWish(bind={"Water": "flask_water"}))
    assert plan["bindings"]["reagents"] == {"Water": "flask_water"}


def test_a_vessel_of_another_id_is_the_only_one_of_its_sort() -> None:
    hardware = '<Component id="pot" type="reactor"/>'
    text = recipe('Add vessel="pot" reagent="water" volume="5 mL"', hardware=hardware)
    plan = compiled(text, bench())
    assert plan["bindings"]["vessels"] == {"pot": "reactor"}
    assert any("only reactor" in note for note in plan["notes"])


def test_two_vessels_that_could_be_meant_are_a_question() -> None:
    graph = bench()
    graph["nodes"].append({"id": "reactor_2", "class": "ChemputerReactor", "max_volume": 100})
    hardware = '<Component id="pot" type="reactor"/>'
    text = recipe('Add vessel="pot" reagent="water" volume="5 mL"', hardware=hardware)
    assert reasons(text, graph) == ["plan.vessel_ambiguous"]
    assert compiled(text, graph, CompileWish(bind={"pot": "reactor"}))
    stirred = recipe(
        'Add vessel="pot" reagent="water" volume="5 mL" stir="True"', hardware=hardware
    )
    assert compiled(stirred, graph)["bindings"]["vessels"] == {"pot": "reactor"}


def test_a_vessel_of_the_wrong_sort_is_refused() -> None:
    hardware = '<Component id="filter" type="separator"/>'
    text = recipe('Add vessel="filter" reagent="water" volume="5 mL"', hardware=hardware)
    assert reasons(text, bench()) == ["plan.wrong_kind"]


def test_a_bind_that_means_nothing_is_refused() -> None:
    wish = CompileWish(bind={"raector": "reactor", "water": "flask_nowhere"})
    assert set(reasons(recipe(ADD), bench(), wish)) == {"plan.unknown_role", "plan.unknown_vessel"}


def test_two_reagents_that_are_bound_to_one_flask_are_refused_before_anything_is_planned() -> None:
    both = recipe(ADD, 'Add vessel="reactor" reagent="ether" volume="5 mL"')
    assert reasons(both, bench(), CompileWish(bind={"ether": "flask_water"})) == [
        "plan.shared_flask"
    ]
    assert reasons(
        both, bench(), CompileWish(bind={"ether": "flask_spare", "water": "flask_spare"})
    ) == ["plan.shared_flask"]


def test_a_heater_that_reaches_the_temperature_is_set_awaited_and_stopped() -> None:
    plan = compiled(recipe(ADD, 'HeatChill vessel="reactor" temp="60 °C" time="1 h"'), bench())
    kinds = [does["kind"] for does in claims(plan)][2:]
    assert kinds == ["stir", "heat", "reach", "wait", "stop_heat", "stop_stir"]
    heat = next(s for s in plan["steps"] if s["does"]["kind"] == "heat")
    assert heat["actions"] == [
        [{"device": "heater", "action": "set_temperature", "parameters": {"temperature_c": 60.0}}]
    ]


def test_what_the_recipe_leaves_running_is_stopped_at_the_end() -> None:
    steps = (
        'StartStir vessel="reactor" stir_speed="300 RPM"',
        'StartHeatChill vessel="reactor" temp="50 °C"',
    )
    plan = compiled(recipe(*steps), bench())
    assert [does["kind"] for does in claims(plan)][-2:] == ["stop_stir", "stop_heat"]


def test_vacuum_joins_the_valve_runs_the_pump_and_is_vented() -> None:
    steps = (
        'AddSolid vessel="filter" reagent="salt" mass="5 g"',
        'Dry vessel="filter" time="1 h" pressure="20 mbar"',
    )
    plan = compiled(recipe(*steps, reagents=("salt",)), bench())
    assert plan["totals"]["needed_ug"] == {"salt": 5_000_000}
    vacuum, _, vent = (s["actions"] for s in plan["steps"][-3:])
    assert vacuum[0][0]["parameters"] == {"pressure_mbar": 20.0}
    assert vacuum[1][0]["parameters"] == {"port": "0"}
    assert [group[0]["action"] for group in vent] == ["set_port", "stop_vacuum", "vent"]
    assert vent[0][0]["parameters"]["port"] not in ("0", "1", "-1")


def test_liquid_is_not_moved_out_of_what_is_evacuated() -> None:
    steps = (
        'Add vessel="filter" reagent="water" volume="5 mL"',
        'SwitchVacuum vessel="filter"',
        'Transfer from_vessel="filter" to_vessel="reactor" volume="all"',
    )
    assert reasons(recipe(*steps), bench()) == ["plan.under_vacuum"]


def test_evacuate_and_refill_ends_under_argon() -> None:
    plan = compiled(recipe('EvacuateAndRefill vessel="filter" repeats="2"'), bench())
    kinds = [does["kind"] for does in claims(plan)]
    assert kinds == ["vacuum", "wait", "vent", "gas", "wait", "stop_gas"] * 2
    assert claims(plan, "vent")[-1]["gas"] == "flask_argon"


def test_phases_are_drawn_to_the_boundary_and_what_follows_is_uncertain() -> None:
    graph = bench()
    plan = compiled(recipe(ADD, SEPARATE), graph)
    parts = [s for s in plan["steps"] if s["does"]["kind"] == "separate"]
    assert [p["does"]["lower_to"] for p in parts] == ["flask_spare", "waste_2"]
    assert parts[0]["does"]["most_ul"] == 80000.0
    flat = [c for group in parts[0]["actions"] for c in group]
    ends = [c["parameters"]["until"] for c in flat if "until" in c["parameters"]]
    assert ends == sorted(ends)
    assert set(ends) == {"boundary", "empty"}
    watching = [c["action"] for c in flat if c["device"] == "sensor"]
    assert watching == ["watch_boundary", "stop_watching"]
    back = claims(plan, "transfer")[-2]
    assert back["from"] == "flask_spare"
    assert back["all"]
    assert back["most_ul"] == 80000.0


def test_a_phase_that_ends_in_the_separator_collects_outside_until_the_last_round() -> None:
    washed = SEPARATE.replace('"extract"', '"wash"') + ' waste_phase_to_vessel="separator"'
    graph = bench()
    plan = compiled(recipe(ADD, washed), graph)
    parts = claims(plan, "separate")
    assert [(p["lower_to"], p["upper_to"]) for p in parts] == [
        ("flask_spare", "separator"),
        ("flask_spare", "filter"),
    ]
    assert claims(plan, "transfer")[-1]["from"] == "flask_spare"
    assert claims(plan, "transfer")[-1]["to"] == "separator"


def test_what_waits_does_so_where_the_recipe_lets_it_go_anyway() -> None:
    graph = bench()
    hardware = (
        '<Component id="reactor" type="reactor"/><Component id="separator" type="separator"/>'
        '<Component id="filter" type="filter"/><Component id="flask_spare" type="flask"/>'
    )
    text = recipe(ADD, SEPARATE + ' waste_phase_to_vessel="flask_spare"', hardware=hardware)
    plan = compiled(text, graph)
    assert [p["lower_to"] for p in claims(plan, "separate")] == ["flask_spare"] * 2


def test_without_a_sensor_a_person_watches_the_boundary() -> None:
    graph = bench()
    graph["nodes"] = [n for n in graph["nodes"] if n["id"] != "sensor"]
    graph["links"] = [link for link in graph["links"] if link["source"] != "sensor"]
    plan = compiled(recipe(ADD, SEPARATE), graph)
    watched = [
        c["action"]
        for s in plan["steps"]
        for group in s["actions"]
        for c in group
        if c["device"] == "@by_hand" and "watch" in c["action"]
    ]
    assert watched == ["watch", "stop_watching"] * 2


def test_where_only_the_most_overflows_a_person_looks_first() -> None:
    plan = compiled(recipe(ADD, SEPARATE), bench(filter=100))
    last = [s for s in plan["steps"] if s["does"]["kind"] == "separate"][-1]
    assert last["actions"][0][0]["action"] == "check"


def test_all_of_an_empty_vessel_is_refused_unless_somebody_says_what_is_in_it() -> None:
    text = recipe('Transfer from_vessel="reactor" to_vessel="filter" volume="all"')
    assert reasons(text, bench()) == ["plan.nothing_there"]
    plan = compiled(text, bench(), CompileWish(holds_nl={"reactor": {"crude": 7_000_000}}))
    assert claims(plan)[0]["most_ul"] == 7000.0


def test_more_than_there_is_cannot_be_moved() -> None:
    move = 'Transfer from_vessel="reactor" to_vessel="filter" volume="61 mL"'
    assert reasons(recipe(ADD, move), bench()) == ["plan.too_little"]


def test_solids_stay_on_a_filter_and_go_with_liquid_elsewhere() -> None:
    steps = (
        'AddSolid vessel="reactor" reagent="salt" mass="2 g"',
        ADD,
        'Transfer from_vessel="reactor" to_vessel="filter" volume="30 mL"',
        'Filter vessel="filter"',
        'WashSolid vessel="filter" solvent="ether" volume="10 mL" repeats="2"',
    )
    graph = bench()
    plan = compiled(recipe(*steps, reagents=("salt", "water", "ether")), graph)
    assert [does["most_ul"] for does in claims(plan, "filter")] == [30000.0, 10000.0, 10000.0]
    check_claims(plan)
    assert check_strokes(plan, graph) == 7


def test_lines_are_rinsed_before_another_liquid_when_a_reagent_for_it_is_named() -> None:
    steps = (ADD, 'Add vessel="reactor" reagent="ether" volume="5 mL"', ADD)
    graph = bench()
    plan = compiled(recipe(*steps), graph, CompileWish(rinse=("ether",)))
    rinses = claims(plan, "clean")
    assert [r["lot"] for r in rinses] == ["ether"] * len(rinses)
    assert len(rinses) == 2
    assert plan["totals"]["delivered_ul"] == {"reactor": {"water": 120000.0, "ether": 5000.0}}
    assert plan["totals"]["needed_ul"]["ether"] == 5000.0 + 2 * 3000.0
    check_claims(plan)
    check_strokes(plan, graph)


def test_counted_loops_go_round_and_those_a_reading_ends_are_refused() -> None:
    text = recipe("Wait time='1 s'").replace("<Wait", '<Repeat repeats="3"><Wait')
    text = text.replace("time='1 s'/>", "time='1 s'/></Repeat>")
    assert len(claims(compiled(text, bench()), "wait")) == 3
    forever = text.replace('<Repeat repeats="3">', "<Loop>").replace("</Repeat>", "</Loop>")
    assert reasons(forever, bench()) == ["plan.open_loop"]


def test_queues_overlap_and_a_step_without_one_waits_for_all() -> None:
    steps = (
        'Stir vessel="reactor" time="10 min" queue="a"',
        'Stir vessel="filter" time="30 min" queue="b"',
        'Wait time="1 min"',
    )
    totals = compiled(recipe(*steps), bench())["totals"]
    assert totals["duration_s"] == 41 * 60 + 8
    assert totals["critical_path_s"] == 31 * 60 + 4


def test_a_lab_of_ours_is_a_rig_too() -> None:
    """The reactor of the starter lab stands on its heater; no edge joins the two."""
    lab = json.loads((ROOT / "fixtures/labs/starter/lab.json").read_text("utf-8"))
    steps = (
        'Add vessel="reactor_1" reagent="Water" volume="12 mL"',
        'HeatChill vessel="reactor_1" temp="40 °C" time="10 min"',
    )
    hardware = '<Component id="reactor_1" type="reactor"/>'
    plan = compiled(recipe(*steps, hardware=hardware, reagents=("Water",)), lab)
    assert plan["contents"]["water"] == [{"lot": "Water", "phase": "liquid", "volume_ul": 400000.0}]
    assert plan["bindings"] == {
        "vessels": {"reactor_1": "reactor_1"},
        "reagents": {"Water": "water"},
    }
    heat = next(s for s in plan["steps"] if s["does"]["kind"] == "heat")
    told = [c["action"] for group in heat["actions"] for c in group]
    assert told == ["check", "set_temperature"]


@pytest.mark.parametrize("time", ["", ' time="10 min"'])
def test_dropwise_says_a_rate_or_is_refused(time: str) -> None:
    text = recipe(f'Add vessel="reactor" reagent="water" volume="6 mL" dropwise="True"{time}')
    if not time:
        assert reasons(text, bench()) == ["xdl.left_open"]
        return
    add = compiled(text, bench())["steps"][-1]
    last = add["actions"][-1][0]
    assert last["action"] == "dispense"
    assert last["parameters"]["rate_ul_s"] == 10.0


def test_a_step_that_no_rig_is_told_yet_is_named() -> None:
    step = 'CConnect from_vessel="reactor" to_vessel="filter"'
    assert set(reasons(recipe(ADD, step), bench())) == {"plan.not_compiled"}


def test_what_the_recipe_says_and_no_operation_does_is_told_by_its_line() -> None:
    given = 'volume="5 mL" prime_n_times="2" purpose="dilute" comment="slowly"'
    text = recipe(
        f'Add vessel="reactor" reagent="water" {given}',
        'Transfer from_vessel="reactor" to_vessel="filter" volume="1 mL" flush_tubing="True"',
    )
    told = [note for note in compiled(text, bench())["notes"] if "no plan does" in note]
    assert told == [
        "Add in line 1: the recipe says prime_n_times, which no plan does",
        "Transfer in line 1: the recipe says flush_tubing, which no plan does",
    ]
