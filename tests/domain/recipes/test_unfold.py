"""Blueprints, parameters, equivalents, loops and queues, as the published tests expect them."""

from __future__ import annotations

import json
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.errors import ProtocolError
from labweb.domain.recipes.xdl.file_format.attribute_values import XdlQuantity
from labweb.domain.recipes.xdl.file_format.read_xdl import read_xdl
from labweb.domain.recipes.xdl.timing.act_times import plan_queues
from labweb.domain.recipes.xdl.unfolding.act_order import RecipeAct, in_order
from labweb.domain.recipes.xdl.unfolding.unfold_recipe import unfold
from tests.corpus import NO_XDL, XDL
from tests.domain.recipes.asking import TEST_TABLE, recipe

needs_corpus = pytest.mark.skipif(not XDL.exists(), reason=NO_XDL)

REASONS = {
    "XDLAttrDuplicateID": "xdl.duplicate_id",
    "XDLSanityCheckError": "xdl.repeat_end",
    "XDLReagentNotDeclaredError": "xdl.reagent_not_declared",
    "XDLVesselNotDeclaredError": "xdl.vessel_not_declared",
    "XDLNoParameterValue": "xdl.no_parameter_value",
    "unknown blueprint step property": "xdl.unknown_property",
}
"""Error of the reference → our code."""

QUEUES = {
    "step_deps.xdl": [1, 5, 10, 3],
    "step_deps_bp_basic.xdl": [1, 2, 3],
    "step_deps_in_bp.xdl": [1, 5, 10, 3],
    "step_deps_on_bp.xdl": [1, 2, 5, 10, 3, 0.5],
    "step_deps_bps_independent.xdl": [1, 4, 5, 2, 9, 10, 3, 6],
}
"""Seconds that the waits last, in the order in which they end by the written rule."""


@cache
def published() -> dict[str, Any]:
    if not XDL.exists():
        return {"cases": []}
    found: dict[str, Any] = json.loads((XDL / "xdl2_expected.json").read_text("utf-8"))
    return found


def case_file(name: str) -> Path:
    (found,) = (XDL / "xdl2_testfiles").rglob(name)
    return found


CASES = {case["file"]: case for case in published()["cases"]}
ERRORS = [name for name, case in CASES.items() if case["expect"].startswith("error")]
FLAT = [name for name, case in CASES.items() if any("flattened" in key for key in case)]


def acts_of(name: str) -> tuple[RecipeAct, ...]:
    read = read_xdl(case_file(name).read_bytes(), table=TEST_TABLE)
    return unfold(read, table=TEST_TABLE, **(CASES[name].get("args") or {}))


def flat(acts: tuple[RecipeAct, ...]) -> list[RecipeAct]:
    return list(
        in_order(acts, lambda act, rounds: rounds >= int(str(act.values["target_repeats"])))
    )


def number(act: RecipeAct, name: str) -> Decimal | None:
    value = act.values.get(name)
    return value.exact if isinstance(value, XdlQuantity) else None


@needs_corpus
def test_there_are_forty_six_published_cases() -> None:
    assert len(CASES) == 46


@needs_corpus
@pytest.mark.parametrize("name", ERRORS)
def test_a_published_error_is_an_error_here(name: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        acts_of(name)
    (code,) = {c for text, c in REASONS.items() if CASES[name]["error"].startswith(text)}
    found = [finding for finding in caught.value.findings if finding.code == code]
    assert found
    if "message" in CASES[name]:
        assert found[0].message == CASES[name]["message"]


@needs_corpus
@pytest.mark.parametrize(
    "name", [n for n, c in CASES.items() if "add_steps_in_execution_order" in c]
)
def test_loops_add_in_the_published_order(name: str) -> None:
    wanted = CASES[name]["add_steps_in_execution_order"]
    added = [act for act in flat(acts_of(name)) if act.name == "Add"]
    assert [{key: act.values[key] for key in wanted[0]} for act in added] == wanted


@needs_corpus
@pytest.mark.parametrize("name", [n for n, c in CASES.items() if "steps_in_execution_order" in c])
def test_loops_until_a_monitor_is_done_go_round_as_published(name: str) -> None:
    wanted = [
        (step, Decimal(props["amount"].split()[0]) if step == "Add" else props["target_repeats"])
        for step, props in CASES[name]["steps_in_execution_order"]
    ]
    found = [act for act in flat(acts_of(name)) if act.name in {"Add", "MockMeasure"}]
    assert [
        (act.name, number(act, "volume") if act.name == "Add" else act.values["target_repeats"])
        for act in found
    ] == wanted


@needs_corpus
def test_all_monitors_are_done_in_the_same_round() -> None:
    measured = [
        act for act in flat(acts_of("repeat_until_done_logic.xdl")) if act.name == "MockMeasure"
    ]
    assert [act.values["comment"] for act in measured] == ["long", "short"] * 4


@needs_corpus
@pytest.mark.parametrize("name", FLAT)
def test_blueprints_unfold_to_the_published_steps_and_amounts(name: str) -> None:
    case = CASES[name]
    (key,) = [key for key in case if "flattened" in key]
    wanted = [step for step in case[key] if step[0] != "SetStirRate"]
    found = flat(acts_of(name))
    assert [act.name for act in found] == [step for step, _ in wanted]
    for act, (_, props) in zip(found, wanted, strict=True):
        for prop in set(props) & {"mass", "volume", "time", "temp", "pressure", "rinsing_volume"}:
            value = act.values.get(prop)
            if isinstance(value, XdlQuantity) and value.word == "all":
                continue  # How much that is, only a rig can tell.
            published_number = props[prop]
            if published_number is None:
                assert value is None
            else:
                assert round(float(number(act, prop) or 0), 4) == published_number
        for prop in set(props) & {"vessel", "reagent", "solvent", "from_vessel", "to_vessel"}:
            assert act.values[prop] == props[prop]


@needs_corpus
@pytest.mark.parametrize(
    ("name", "place", "volume"),
    [
        ("overwrite_default_bp_reagents.xdl", 0, "8.63"),
        ("use_default_bp_reagents_twice.xdl", 0, "8.63"),
        ("use_default_bp_reagents_twice.xdl", 1, "12.94"),
    ],
)
def test_a_blueprint_counts_its_own_equivalents(name: str, place: int, volume: str) -> None:
    uses = [act for act in acts_of(name) if act.is_blueprint]
    added = number(uses[place].children[2], "volume")
    assert round(added or Decimal(0), 2) == Decimal(volume)


@needs_corpus
def test_a_default_reagent_gives_way_to_a_mapped_one() -> None:
    (use,) = [
        a for a in acts_of("overwrite_default_bp_reagents_diff_reagent.xdl") if a.is_blueprint
    ]
    wanted = CASES["overwrite_default_bp_reagents_diff_reagent.xdl"]
    ((_, steps),) = [(k, v) for k, v in wanted.items() if k.startswith("blueprint_steps")]
    for place, props in steps.items():
        assert use.children[int(place)].values["solvent"] == props["solvent"]


@needs_corpus
def test_nested_blueprints_hand_their_reagents_down() -> None:
    name = "overwrite_default_bp_reagents_nested.xdl"
    used = {
        str(act.values[key])
        for act in flat(acts_of(name))
        for key in ("reagent", "solvent")
        if key in act.values
    }
    assert set(CASES[name]["reagents_that_must_be_added"]) <= used
    assert not used & set(CASES[name]["reagents_that_must_not"])


@needs_corpus
def test_loop_variables_match_what_the_blueprint_declares() -> None:
    dissolved = [a for a in flat(acts_of("two_GV_BP_scope.xdl")) if a.name == "Dissolve"]
    assert [(a.values["vessel"], a.values["solvent"]) for a in dissolved] == [
        ("reactor", "solvent")
    ]
    added = [a for a in flat(acts_of("multiple_loop_variable_syn.xdl")) if a.name == "Add"]
    assert [(a.values["reagent"], a.values["vessel"]) for a in added] == [
        ("reagent_12", "reactor"),
        ("reagent_14", "UVVis"),
    ]
    assert len([a for a in flat(acts_of("repeat_PFE_delay.xdl")) if a.is_blueprint]) == 4


@needs_corpus
@pytest.mark.parametrize("name", QUEUES)
def test_waits_end_in_the_order_that_the_written_rule_gives(name: str) -> None:
    ended = [float(number(slot.act, "time") or 0) for slot in plan_queues(acts_of(name))]
    assert ended == QUEUES[name]


@needs_corpus
def test_the_published_orders_of_queues_do_not_fit_their_own_files() -> None:
    # The test they come from is skipped by its authors; one lists a wait that its file lacks.
    wanted = {
        n: c["wait_steps_finish_order_s"]
        for n, c in CASES.items()
        if "wait_steps_finish_order_s" in c
    }
    assert wanted["step_deps_bp_basic.xdl"] == QUEUES["step_deps_bp_basic.xdl"]
    in_blueprint = {
        float(number(a, "time") or 0)
        for a in flat(acts_of("step_deps_in_bp.xdl"))
        if "time" in a.values
    }
    assert set(wanted["step_deps_in_bp.xdl"]) - in_blueprint == {2.0}


@needs_corpus
@pytest.mark.parametrize("moles", ["0.1", "3.3", "4"])
@pytest.mark.parametrize("by", ["ether", "NaCl", "chloroacetyl chloride"])
def test_equivalents_become_volumes_and_masses(by: str, moles: str) -> None:
    read = read_xdl(case_file("add_equivalents.xdl").read_bytes())
    n = Decimal(moles)
    acts = unfold(read, equiv_reference=by, equiv_amount=f"{moles} mol")
    chloride, ether, again, salt = acts
    assert float(number(chloride, "volume") or 0) == pytest.approx(float(2 * n / 100 * 1000))
    assert float(number(ether, "volume") or 0) == pytest.approx(
        float(Decimal("2.9") * n * Decimal("46.07") / Decimal("2.6"))
    )
    assert float(number(again, "volume") or 0) == pytest.approx(
        float(n * Decimal("46.07") / Decimal("2.6"))
    )
    assert float(number(salt, "mass") or 0) == pytest.approx(float(6 * n * Decimal("58.443")))


TRANSFER_BY_MASS = '<Transfer from_vessel="reactor" to_vessel="flask" amount="1 g"/>'
ADD_EQ = '<Add vessel="reactor" reagent="water" amount="2 eq"/>'


@pytest.mark.parametrize(
    ("steps", "args", "code"),
    [
        (ADD_EQ, {}, "xdl.no_equivalents"),
        (ADD_EQ, {"equiv_reference": "water"}, "xdl.equivalents_incomplete"),
        (ADD_EQ, {"equiv_amount": "1 g"}, "xdl.equivalents_incomplete"),
        (ADD_EQ, {"equiv_reference": "sugar", "equiv_amount": "1 g"}, "xdl.equivalents_reference"),
        (ADD_EQ, {"equiv_reference": "water", "equiv_amount": "1 s"}, "unit.unknown"),
        (ADD_EQ, {"equiv_reference": "water", "equiv_amount": "1 eq"}, "xdl.amount_unresolved"),
        ('<Add vessel="reactor" reagent="water" amount="1-2 g"/>', {}, "xdl.range_not_exact"),
        ('<Add vessel="reactor" reagent="water" amount="1 g/eq"/>', {}, "xdl.no_equivalents"),
        ('<Add vessel="reactor" reagent="salt" amount="1 mL"/>', {}, "xdl.amount_unresolved"),
        (
            TRANSFER_BY_MASS,
            {},
            "xdl.amount_unresolved",
        ),
        ('<Repeat x.role="nobody"><Wait time="1 s"/></Repeat>', {}, "xdl.loop_matches_nothing"),
        ("<Wait time='1 s'/>", {"parameters": {"p": "1 s"}}, "xdl.no_parameter_value"),
    ],
)
def test_what_is_left_open_is_refused(steps: str, args: dict[str, Any], code: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        unfold(recipe(steps), **args)
    assert code in {finding.code for finding in caught.value.findings}


@pytest.mark.parametrize(
    ("step", "wanted"),
    [
        ('<Add vessel="reactor" reagent="water" mass="3 g"/>', {"volume": 3}),
        ('<Add vessel="reactor" reagent="salt" mass="3 g"/>', {"mass": 3}),
        ('<Add vessel="reactor" reagent="water" volume="5 mL" mass="5 g"/>', {"volume": 5}),
        ('<AddSolid vessel="reactor" reagent="salt" mass="58.4 g" mol="1 mol"/>', {"mass": 58.4}),
        ('<AddSolid vessel="reactor" reagent="salt" mol="1 mol"/>', {"mass": 58.443}),
        ('<Add vessel="reactor" reagent="water" amount="1 mol"/>', {"volume": 18}),
    ],
)
def test_a_liquid_is_measured_by_volume_and_a_solid_by_mass(
    step: str, wanted: dict[str, float]
) -> None:
    (act,) = unfold(recipe(step))
    measured = {name: number(act, name) for name in ("volume", "mass")}
    assert {k: float(v) for k, v in measured.items() if v is not None} == wanted


@pytest.mark.parametrize("name", ["amount", "mass"])
def test_a_mass_of_what_has_no_known_density_is_weighed_in(name: str) -> None:
    tar = '<Reagent name="tar" molecular_weight="18 g/mol"/>'
    (act,) = unfold(recipe(f'<Add vessel="reactor" reagent="tar" {name}="5 g"/>', reagents=tar))
    assert (number(act, "mass"), number(act, "volume")) == (Decimal(5), None)


def test_a_parameter_keeps_its_limits_and_gives_way_to_what_is_given() -> None:
    declared = '<Parameter id="t" type="time" value="1 h" min="10 min" max="2 h"/>'
    extra = f"<Parameters>{declared}</Parameters>"
    read = recipe('<Wait time="t"/>', extra=extra)
    assert number(unfold(read)[0], "time") == 3600
    assert number(unfold(read, parameters={"t": "30 min"})[0], "time") == 1800
    for wrong in ("5 min", "3 h"):
        with pytest.raises(ProtocolError) as caught:
            unfold(read, parameters={"t": wrong})
        assert caught.value.code == "xdl.parameter_limit"


def test_a_step_without_a_queue_waits_for_all_and_vessels_are_never_shared() -> None:
    steps = (
        '<Stir vessel="reactor" time="10 s" queue="a"/>'
        '<Stir vessel="reactor" time="5 s" queue="b"/>'
        '<Stir vessel="flask" time="3 s" queue="c"/><Wait time="1 s"/>'
    )
    slots = plan_queues(unfold(recipe(steps)))
    assert [(int(s.start_s), int(s.end_s)) for s in slots] == [(0, 3), (0, 10), (10, 15), (15, 16)]


def test_an_async_goes_on_until_it_is_awaited() -> None:
    steps = (
        '<Async pid="a"><Stir vessel="flask" time="10 s"/></Async>'
        '<Stir vessel="reactor" time="4 s"/>'
        '<Await pid="a"/><Wait time="1 s"/>'
    )
    ended = [int(slot.end_s) for slot in plan_queues(unfold(recipe(steps)))]
    assert ended == [4, 10, 11]
