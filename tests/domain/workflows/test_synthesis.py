"""A recipe becomes a workflow, and that a plan of actions, on a station of four pumps.

```text
      THF PhMgBr PhCHO NH₄Cl Et₃N AcCl     water brine ether        DCM
        └────┴────┴──V1───┴────┴────┘        └────V2────┘            │
                     │                       │    │   └MgSO₄▸crude──V3─silica▸┐
                  reactor ───────────────────┘ separator              └── rotavap flask
                     └──────────────────V4────────────────────────────────┘
```
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from typing import Any

import msgspec
import pytest

from labweb.domain.crutd.operations import React, TransferLiquid
from labweb.domain.errors import Finding, ProtocolError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.recipes.xdl.as_workflow.recipe_to_workflow import to_workflow
from labweb.domain.recipes.xdl.file_format.read_xdl import read_xdl
from labweb.domain.recipes.xdl.lab_choices.declarations_file import Declared, read_declared
from labweb.domain.recipes.xdl.unfolding.unfold_recipe import unfold
from labweb.domain.workflows.compile_workflow import check_plan, compile_workflow
from labweb.domain.workflows.plan import Plan
from labweb.domain.workflows.plan_proof.prove_workflow import prove_plan
from labweb.domain.workflows.workflow_file import parse_workflow, resolve_keys
from tests.domain.workflows.station import (
    DECLARED,
    LAB,
    RECIPE,
    in_a_chain,
    recipe_document,
    station,
    station_file,
    view_of,
    workflow,
)

TWO_LAYERS = {"brine": 10_000.0, "ether": 20_000.0}


@cache
def recipe_plan() -> Plan:
    return compile_workflow(workflow(recipe_document()), station())


def one_step(kind: str, **params: Any) -> dict[str, Any]:  # noqa: ANN401 - what a step takes
    step = {"id": "s", "kind": kind, "params": params, "position": {"x": 0, "y": 0}}
    return {"schema": "labweb.workflow/1", "name": "One", "steps": [step], "edges": []}


def jobs_of(document: dict[str, Any], **contents: dict[str, float]) -> list[tuple[str, Any]]:
    plan = compile_workflow(workflow(document), station(**contents))
    return [(job.action, job.operation) for job in plan.jobs if job.action != "initialize"]


def findings_of(document: dict[str, Any], **contents: dict[str, float]) -> list[Finding]:
    return check_plan(workflow(document), station(**contents))


def separating(**more: Any) -> dict[str, Any]:  # noqa: ANN401 - what a step takes
    params = {"lower": {"brine": "all"}, "settle_for": "5 min", **more}
    return one_step("separate", vessel="@separator", target="@waste", **params)


def evaporating(**more: Any) -> dict[str, Any]:  # noqa: ANN401 - what a step takes
    params: dict[str, Any] = {"temperature": "40 °C", "pressure": "50 mbar", "speed": "120 rpm"}
    params |= {"duration": "30 min", "boils_off": {"ether": "all"}, "receiver": "@rotavap_receiver"}
    return one_step("evaporate", **{"vessel": "@rotavap_flask", **params, **more})


def refilling(**more: Any) -> dict[str, Any]:  # noqa: ANN401 - what a step takes
    params = {"vessel": "@reactor", "gas": "@argon", "pressure": "50 mbar", "rounds": "2"}
    return one_step("evacuate_refill", **{**params, **more})


def test_the_recipe_compiles_on_the_station_to_its_end() -> None:
    found = check_plan(workflow(recipe_document()), station())
    assert not found, [(f.subject, f.code, f.message) for f in found]
    assert len(recipe_plan().steps) == 45


def test_the_same_workflow_is_planned_and_proved_on_a_chain_of_valves() -> None:
    lab = view_of(read_lab(json.dumps(in_a_chain()).encode()), {})
    document = json.loads((LAB / "workflows/benzhydryl_acetate.json").read_text("utf-8"))
    asked = resolve_keys(parse_workflow(document), lab.tree)
    plan = compile_workflow(asked, lab)
    handed_on = [job for job in plan.jobs if isinstance(job.meets, int)]
    assert len(handed_on) > 30
    proof = prove_plan(asked, plan, lab)
    assert (proof.findings, proof.beyond) == ((), ())


def test_the_template_of_the_lab_is_what_the_recipe_says() -> None:
    template = json.loads((LAB / "workflows/benzhydryl_acetate.json").read_text("utf-8"))
    assert template == recipe_document()


def test_no_liquid_is_left_in_a_syringe_between_two_steps() -> None:
    moves = [
        (job.step_id, job.operation)
        for job in recipe_plan().jobs
        if job.action in {"aspirate", "dispense"}
    ]
    for (step, draw), (same, push) in zip(moves[::2], moves[1::2], strict=True):
        assert step == same
        assert isinstance(draw, TransferLiquid)
        assert isinstance(push, TransferLiquid)
        assert (draw.target_id, draw.amount_nl) == (push.source_id, push.amount_nl)


def test_each_reaction_says_which_lot_its_yield_is_on() -> None:
    reactions = [job.operation for job in recipe_plan().jobs if isinstance(job.operation, React)]
    assert [one.products[0].key for one in reactions] == ["diphenylmethanol", "benzhydryl_acetate"]
    assert reactions[1].basis == reactions[0].products[0].lot_id
    assert not any(one.basis is msgspec.UNSET for one in reactions)


def test_the_lower_layer_is_drawn_lot_by_lot() -> None:
    jobs = jobs_of(separating(), separator=TWO_LAYERS)
    assert [action for action, _ in jobs] == [
        *("wait", "select_port", "aspirate", "select_port", "dispense")
    ]
    draw = jobs[2][1]
    (brine,) = (str(lot.id) for lot in station_file().lots if lot.key == "brine")
    assert draw.parts_nl == {brine: 10_000_000}


def test_all_of_a_vessel_is_what_is_in_it_by_then() -> None:
    document = one_step("transfer", source="@separator", target="@crude", volume="all")
    document["steps"][0]["params"]["through"] = "@cartridge_mgso4"
    drawn = [o.amount_nl for a, o in jobs_of(document, separator=TWO_LAYERS) if a == "aspirate"]
    assert sum(drawn) == 30_000_000


def test_a_cartridge_is_passed_only_when_it_is_named() -> None:
    plain = one_step("transfer", source="@separator", target="@crude", volume="all")
    (found,) = findings_of(plain, separator=TWO_LAYERS)
    assert found.code in {"plan.no_route", "plan.needs_relay"}


def test_an_evaporation_moves_what_is_stated_at_the_end_of_its_time() -> None:
    jobs = jobs_of(evaporating(), rotavap_flask={"ether": 20_000.0, "tea": 5000.0})
    assert [action for action, _ in jobs] == [
        *("heat_bath_to", "rotate", "lower_flask", "evacuate_to", "wait"),
        *("vent", "raise_flask", "stop_rotating", "stop_heating"),
    ]
    assert jobs[4][1].amount_nl == 20_000_000


def test_a_vessel_is_evacuated_and_left_under_the_gas() -> None:
    plan = compile_workflow(workflow(refilling()), station())
    turns = [job.args["port_index"] for job in plan.jobs if job.action == "select_port"]
    assert turns == [1, 2, 1, 2]
    assert [job.action for job in plan.jobs].count("evacuate_to") == 2


def test_a_vessel_is_evacuated_by_the_tube_that_also_drains_it() -> None:
    """vacuum ──1│valve│common ──liquid── reactor, as on the rigs of Chemputers"""
    lab = station_file()
    tubes = tuple(
        replace(one, medium=Medium.LIQUID) if one.key == "reactor_valve_gas" else one
        for one in lab.connections
    )
    assert tubes != lab.connections
    plan = compile_workflow(workflow(refilling()), view_of(replace(lab, connections=tubes), {}))
    turns = [job.args["port_index"] for job in plan.jobs if job.action == "select_port"]
    assert turns == [1, 2, 1, 2]


@pytest.mark.parametrize(
    ("document", "contents", "code"),
    [
        (separating(lower={"gold": "all"}), {"separator": TWO_LAYERS}, "plan.no_lot"),
        (separating(lower={}), {"separator": TWO_LAYERS}, "plan.no_lot"),
        (
            separating(lower={"brine": "11 mL"}),
            {"separator": TWO_LAYERS},
            "crutd.insufficient_volume",
        ),
        (separating(lower={"brine": "ten"}), {"separator": TWO_LAYERS}, "unit.unreadable"),
        (separating(), {}, "crutd.insufficient_volume"),
        (evaporating(), {}, "crutd.insufficient_volume"),
        (
            evaporating(receiver="@crude"),
            {"rotavap_flask": {"ether": 1000.0}},
            "plan.no_condenser",
        ),
        (evaporating(vessel="@crude"), {"crude": {"ether": 1000.0}}, "plan.no_device"),
        (refilling(), {"reactor": {"ether": 1000.0}}, "plan.not_empty"),
        (refilling(rounds="0"), {}, "plan.bad_rounds"),
        (refilling(rounds="often"), {}, "plan.bad_rounds"),
        (refilling(vessel="@separator"), {}, "plan.no_gas"),
        (refilling(gas="@bottle_thf"), {}, "plan.no_gas"),
        (
            one_step("transfer", source="@crude", target="@rotavap_flask", volume="all"),
            {},
            "crutd.insufficient_volume",
        ),
        (
            one_step("start_stir", vessel="@crude", stir_speed="100 rpm"),
            {},
            "plan.no_device",
        ),
    ],
)
def test_what_the_station_cannot_do_is_refused(
    document: dict[str, Any], contents: dict[str, dict[str, float]], code: str
) -> None:
    assert code in {finding.code for finding in findings_of(document, **contents)}


def convert(declared: Declared) -> list[str]:
    acts = unfold(read_xdl(RECIPE.read_bytes()))
    with pytest.raises(ProtocolError) as caught:
        to_workflow(acts, name="Recipe", declared=declared)
    return [finding.code for finding in caught.value.findings]


def test_where_vapour_condenses_must_be_declared() -> None:
    declared = msgspec.structs.replace(read_declared(DECLARED.read_bytes()), receivers={})
    assert set(convert(declared)) >= {"xdl.not_declared"}


@pytest.mark.parametrize(
    ("change", "kind"), [("lower_layers", "separate"), ("boils_off", "evaporate")]
)
def test_the_recipe_starts_with_lots_that_are_stated_during_the_run(change: str, kind: str) -> None:
    """The recipe's own reactions take exact amounts, so that only what boils off is left open."""
    declared = msgspec.structs.replace(read_declared(DECLARED.read_bytes()), **{change: []})
    document = to_workflow(unfold(read_xdl(RECIPE.read_bytes())), name="R", declared=declared)
    plan = compile_workflow(workflow(document), station())
    asked = [job for job in plan.jobs if job.states]
    steps = {step.step_id for step in plan.steps if step.kind == kind}
    assert {job.step_id for job in asked} == steps


def test_a_reaction_behind_a_step_that_is_not_there_is_told() -> None:
    declared = read_declared(DECLARED.read_bytes())
    late = msgspec.structs.replace(declared.reactions[0], after=99)
    assert convert(msgspec.structs.replace(declared, reactions=[late])) == ["xdl.not_declared"]


@pytest.mark.parametrize("raw", [b"", b"{}x", b'{"colour": 1}', b'{"schema": "other/1"}'])
def test_a_declaration_that_cannot_be_read_is_refused(raw: bytes) -> None:
    with pytest.raises(ProtocolError) as caught:
        read_declared(raw)
    assert caught.value.code == "xdl.not_declared"
