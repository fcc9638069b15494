"""What a step leaves open is asked for in the run; until then all after it is a first plan."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.errors import InfeasibleError, ProtocolError
from labweb.domain.workflows.compile_workflow import check_plan, compile_workflow
from labweb.domain.workflows.plan import Plan, PlannedJob, digest
from labweb.domain.workflows.plan_proof.prove_workflow import WorkflowProof, prove_plan
from tests.domain.workflows.solids import steps
from tests.domain.workflows.station import station, workflow

SEPARATOR = {"brine": 10_000.0, "ether": 20_000.0}
PARTS = {"vessel": "@separator", "target": "@waste", "settle_for": "5 min"}
BOILS = {
    "vessel": "@rotavap_flask",
    "receiver": "@rotavap_receiver",
    "temperature": "40 °C",
    "pressure": "50 mbar",
    "speed": "120 rpm",
    "duration": "30 min",
}
OVER = {"source": "@separator", "target": "@reactor", "volume": "all"}


def planned(
    *made: tuple[str, dict[str, Any]], **contents: dict[str, float]
) -> tuple[Plan, WorkflowProof]:
    document, lab = workflow(steps(*made)), station(**contents)
    plan = compile_workflow(document, lab)
    return plan, prove_plan(document, plan, lab)


def of_step(plan: Plan, step_id: str) -> list[PlannedJob]:
    return [job for job in plan.jobs if job.step_id == step_id and job.action != "initialize"]


def test_a_layer_that_nobody_stated_is_asked_for_first_and_nothing_goes_before_it() -> None:
    plan, proof = planned(("separate", PARTS), ("transfer", OVER), separator=SEPARATOR)
    first, *others = of_step(plan, "s0")
    assert first.asks == "Which lots lie in the lower layer of Separator, and how much of each?"
    assert first.states
    assert (first.states.field, first.states.label) == ("lower", "Lower layer")
    assert others[0].after == (first.index,)
    assert all(not job.asks for job in others)
    assert proof.findings == ()
    assert [one.step_id for one in proof.beyond] == ["s0", "s1"]
    assert "states 'Lower layer' during the run" in proof.beyond[0].why


def test_until_it_is_stated_half_of_each_lot_is_planned() -> None:
    plan, _ = planned(("separate", PARTS), separator=SEPARATOR)
    drawn = [
        job.operation
        for job in of_step(plan, "s0")
        if job.action == "aspirate" and isinstance(job.operation, TransferLiquid)
    ]
    assert sum(one.amount_nl for one in drawn) == 15_000_000


def test_what_boils_off_is_asked_for_before_anything_is_warmed() -> None:
    plan, proof = planned(("evaporate", BOILS), rotavap_flask={"ether": 1000.0})
    first, second, *_ = of_step(plan, "s0")
    assert first.asks == "What of each lot in Evaporating flask will boil off?"
    assert (second.action, second.after) == ("heat_bath_to", (first.index,))
    assert proof.findings == ()


def test_amounts_that_depend_on_what_is_stated_refuse_nothing_yet() -> None:
    """The flask would run over with half of what it holds, and is empty if all boils off."""
    pour = ("transfer", {"source": "@crude", "target": "@rotavap_flask", "volume": "all"})
    full = {"rotavap_flask": {"ether": 240_000.0}, "crude": {"ether": 200_000.0}}
    with pytest.raises(InfeasibleError, match="room for"):
        planned(("evaporate", {**BOILS, "boils_off": {"ether": "120 mL"}}), pour, **full)
    plan, proof = planned(("evaporate", BOILS), pour, **full)
    assert [step.step_id for step in plan.steps] == ["s0", "s1"]
    assert proof.findings == ()


def test_a_vessel_that_an_open_one_is_emptied_into_is_not_too_small_yet() -> None:
    pour = ("transfer", {"source": "@rotavap_flask", "target": "@reactor", "volume": "all"})
    full = {"rotavap_flask": {"ether": 240_000.0}, "reactor": {"ether": 200_000.0}}
    plan, proof = planned(("evaporate", BOILS), pour, **full)
    assert [step.step_id for step in plan.steps] == ["s0", "s1"]
    assert proof.findings == ()


def test_amounts_elsewhere_are_refused_as_ever() -> None:
    dry = {"source": "@reactor", "target": "@separator", "volume": "1 mL"}
    document = workflow(steps(("evaporate", BOILS), ("transfer", dry)))
    found = check_plan(document, station(rotavap_flask={"ether": 1000.0}))
    assert {(one.code, one.subject) for one in found} == {("crutd.insufficient_volume", "s1")}


@pytest.mark.parametrize("lacks", ["pressure", "receiver"])
def test_what_is_not_for_the_run_to_say_is_said_before(lacks: str) -> None:
    left = {name: text for name, text in BOILS.items() if name != lacks}
    with pytest.raises(ProtocolError, match=lacks):
        workflow(steps(("evaporate", left)))


def test_an_empty_vessel_has_nothing_to_state() -> None:
    found = check_plan(workflow(steps(("separate", PARTS))), station())
    assert {one.code for one in found} == {"plan.nothing_there"}


def test_a_plan_that_leaves_nothing_open_is_written_as_before() -> None:
    stated = {**PARTS, "lower": {"brine": "all"}}
    plan, proof = planned(("separate", stated), separator=SEPARATOR)
    assert "states" not in str(digest(plan))
    assert all(not job.states for job in plan.jobs)
    assert (proof.covered, proof.beyond) == (("s0",), ())


def test_what_is_drawn_from_another_vessel_is_judged_though_it_goes_into_an_open_one() -> None:
    pour = {"source": "@reactor", "target": "@separator", "volume": "100 mL"}
    document = workflow(steps(("separate", PARTS), ("transfer", pour)))
    found = check_plan(document, station(separator=SEPARATOR))
    assert {(one.code, one.subject) for one in found} == {("crutd.insufficient_volume", "s1")}


def test_the_valve_before_a_vacuum_is_held_while_it_is_drawn() -> None:
    dry = {"vessel": "@reactor", "pressure": "50 mbar", "duration": "10 min"}
    plan, _ = planned(("dry", dry))
    turn, *drawn = of_step(plan, "s0")
    assert turn.action == "select_port"
    valve = set(turn.locks)
    assert all(valve <= set(job.locks) for job in drawn if job.action != "wait")
