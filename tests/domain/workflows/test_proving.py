"""The plan of a workflow is carried out on paper; one fault of the planner and it is refused.

::

    water ── 1│valve 1│common ── pump 1 (5 mL)
    dye ──── 2│       │
    reactor  3│       │
    flask ── 4│       │
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any
from uuid import UUID

import pytest
from msgspec.structs import replace as changed

from labweb.domain.crutd.operations import TransferLiquid, Update
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.workflows.plan import Plan, PlannedJob
from labweb.domain.workflows.plan_proof.prove_workflow import WorkflowProof, prove_plan
from labweb.domain.workflows.plan_proof.step_claims import NOT_PROVED
from tests.domain.workflows.asking import plan_of, read
from tests.domain.workflows.bench import Bench, a_bench, chain, flow, id_of, step, transfer

Mutant = Callable[[Plan], Plan]

THREE = chain(
    transfer("a", "water", "reactor", "12 mL"),
    transfer("b", "dye", "flask", "2 mL"),
    transfer("c", "reactor", "flask", "all"),
)


def proof_of(
    bench: Bench, value: dict[str, Any], mutant: Mutant = lambda plan: plan
) -> WorkflowProof:
    plan = mutant(plan_of(bench, value))
    return prove_plan(read(bench, value), plan, bench.view())


def _places(plan: Plan, action: str, step_id: str = "a") -> list[int]:
    return [job.index for job in plan.jobs if (job.action, job.step_id) == (action, step_id)]


def _with(plan: Plan, jobs: list[PlannedJob]) -> Plan:
    return changed(plan, jobs=tuple(jobs))


def other(place: int, action: str = "select_port", step_id: str = "a", **args: object) -> Mutant:
    """Give one job other arguments."""

    def mutate(plan: Plan) -> Plan:
        jobs = list(plan.jobs)
        index = _places(plan, action, step_id)[place]
        jobs[index] = changed(jobs[index], args={**jobs[index].args, **args})
        return _with(plan, jobs)

    return mutate


def moving(place: int, action: str, volume_ul: float, step_id: str = "a") -> Mutant:
    """Move another volume, and book it, too."""

    def mutate(plan: Plan) -> Plan:
        jobs = list(plan.jobs)
        index = _places(plan, action, step_id)[place]
        job = jobs[index]
        assert isinstance(job.operation, TransferLiquid)
        booked = changed(job.operation, amount_nl=round(volume_ul * 1000))
        args = {**job.args, "volume_ul": volume_ul}
        jobs[index] = changed(job, args=args, operation=booked)
        return _with(plan, jobs)

    return mutate


def without(place: int, action: str, step_id: str = "a", count: int = 1) -> Mutant:
    """Leave jobs out."""

    def mutate(plan: Plan) -> Plan:
        first = _places(plan, action, step_id)[place]
        return _with(plan, [*plan.jobs[:first], *plan.jobs[first + count :]])

    return mutate


def again(place: int, action: str, step_id: str = "a", count: int = 1) -> Mutant:
    """Do jobs twice."""

    def mutate(plan: Plan) -> Plan:
        first = _places(plan, action, step_id)[place]
        twice = plan.jobs[first : first + count]
        return _with(plan, [*plan.jobs[: first + count], *twice, *plan.jobs[first + count :]])

    return mutate


def swapped(place: int, action: str, step_id: str = "a") -> Mutant:
    """Do a job after the one that follows it."""

    def mutate(plan: Plan) -> Plan:
        jobs = list(plan.jobs)
        first = _places(plan, action, step_id)[place]
        jobs[first], jobs[first + 1] = jobs[first + 1], jobs[first]
        return _with(plan, jobs)

    return mutate


def booked(place: int, action: str, step_id: str = "a", **fields: UUID | int) -> Mutant:
    """Book a stroke otherwise than it is made."""

    def mutate(plan: Plan) -> Plan:
        jobs = list(plan.jobs)
        index = _places(plan, action, step_id)[place]
        operation = jobs[index].operation
        assert isinstance(operation, TransferLiquid)
        jobs[index] = changed(jobs[index], operation=changed(operation, **fields))
        return _with(plan, jobs)

    return mutate


def in_step(step_id: str, taken: str) -> Mutant:
    """Let the jobs of one step stand in another."""

    def mutate(plan: Plan) -> Plan:
        return _with(
            plan,
            [changed(job, step_id=taken) if job.step_id == step_id else job for job in plan.jobs],
        )

    return mutate


def steps_swapped(plan: Plan) -> Plan:
    first, second, third = plan.steps
    return changed(plan, steps=(third, first, second))


MUTANTS: dict[str, Mutant] = {
    "the valve one port off, towards another source": other(0, port_index=2),
    "the valve one port off, towards another target": other(1, port_index=4),
    "the valve at a port that no tube joins": other(0, port_index=7),
    "the valve turned back before it is pushed": other(1, port_index=1),
    "the valve of a later stroke one port off": other(4, port_index=4),
    "the source of the second step is that of the first": other(0, step_id="b", port_index=1),
    "a stroke too few": without(0, "select_port", count=4),
    "a stroke too many": again(0, "select_port", count=4),
    "a whole step left out": without(0, "select_port", step_id="b", count=4),
    "a draw left out": without(0, "aspirate"),
    "a push left out, the syringe keeps its liquid": without(2, "dispense"),
    "a draw done twice, the syringe is overfull": again(0, "aspirate"),
    "a push done twice": again(0, "dispense"),
    "the turn to the source left out": without(0, "select_port"),
    "the turn to the target left out": without(1, "select_port"),
    "the valve is turned after the draw": swapped(0, "select_port"),
    "the valve is turned after the push": swapped(1, "select_port"),
    "too little drawn and pushed": lambda plan: moving(0, "dispense", 3000.0)(
        moving(0, "aspirate", 3000.0)(plan)
    ),
    "too much drawn and pushed": lambda plan: moving(0, "dispense", 5000.0)(
        moving(0, "aspirate", 5000.0)(plan)
    ),
    "more pushed than drawn": moving(0, "dispense", 4500.0),
    "less pushed than drawn": moving(0, "dispense", 3500.0),
    "a thousandth too little": lambda plan: moving(0, "dispense", 3996.0)(
        moving(0, "aspirate", 3996.0)(plan)
    ),
    "a draw beyond the syringe": moving(0, "aspirate", 5100.0),
    "all of a vessel, but for a stroke": without(0, "select_port", step_id="c", count=4),
    "more booked than is moved": booked(0, "aspirate", amount_nl=4_500_000),
    "booked out of another vessel": booked(0, "aspirate", source_id=id_of("dye")),
    "booked into another vessel": booked(0, "dispense", target_id=id_of("flask")),
    "the jobs of one step in another": in_step("b", "a"),
    "the last step first": steps_swapped,
}


def dropped(plan: Plan) -> Plan:
    """Leave a step out, with all its jobs."""
    return changed(
        plan,
        steps=tuple(one for one in plan.steps if one.step_id != "b"),
        jobs=tuple(job for job in plan.jobs if job.step_id != "b"),
    )


def twice(plan: Plan) -> Plan:
    return changed(plan, steps=(*plan.steps, plan.steps[0]))


MUTANTS |= {
    "a step is left out with its jobs": dropped,
    "a step is there twice": twice,
    "jobs of a step that nobody has drawn": in_step("b", "z"),
}


@pytest.mark.parametrize("gas", [False, True])
def test_a_step_that_moves_no_matter_may_not_move_any(gas: bool) -> None:
    value = chain(transfer("a", "water", "reactor", "1 mL"), step("w", "wait", duration="5 s"))

    def mutant(plan: Plan) -> Plan:
        stroke = plan.jobs[_places(plan, "aspirate")[0]]
        assert isinstance(stroke.operation, TransferLiquid)
        if gas:
            booked = Update(resource_id=stroke.operation.target_id, data={})
            stroke = changed(stroke, operation=booked)
        return _with(plan, [*plan.jobs, changed(stroke, step_id="w", index=len(plan.jobs))])

    found = proof_of(a_bench(), value, mutant).findings
    assert [one.subject for one in found] == ["w"]
    assert "moves or changes matter" in found[0].message


def test_what_the_planner_makes_is_proved() -> None:
    proof = proof_of(a_bench(), THREE)
    assert proof.findings == ()
    assert proof.covered == ("a", "b", "c")
    assert proof.beyond == ()


@pytest.mark.parametrize("name", MUTANTS)
def test_one_fault_of_the_planner_is_refused_at_its_step(name: str) -> None:
    proof = proof_of(a_bench(), THREE, MUTANTS[name])
    assert proof.findings, name
    assert {one.code for one in proof.findings} == {NOT_PROVED}
    assert {one.subject for one in proof.findings} <= {"a", "b", "c", ""}
    assert any(one.subject for one in proof.findings)


def test_a_finding_says_what_was_asked_and_what_was_found_instead() -> None:
    mutant = MUTANTS["the valve one port off, towards another source"]
    (finding, *_) = proof_of(a_bench(), THREE, mutant).findings
    assert finding.message.startswith("Transfer 12 mL from Water to Reactor: the plan would do")
    assert "liquid goes from dye to reactor" in finding.message


def test_the_lab_as_it_is_now_is_proved_and_not_as_it_was() -> None:
    bench = a_bench()
    plan = plan_of(bench, THREE)
    bench.states[id_of("dye")] = replace(
        bench.states[id_of("dye")], contents={LotId("dye"): 1_000_000}
    )
    found = prove_plan(read(bench, THREE), plan, bench.view()).findings
    assert {one.subject for one in found} == {"b"}
    assert "holds for certain 1000 µL" in found[0].message


def test_a_syringe_that_holds_liquid_is_beyond_the_proof_until_it_is_emptied() -> None:
    bench = a_bench(contents={LotId("dye"): 1_000_000})
    value = chain(
        step("out", "empty_syringe", pump="@pump_1", target="@flask"),
        transfer("a", "water", "reactor", "1 mL"),
        transfer("b", "flask", "reactor", "1 mL"),
    )
    proof = proof_of(bench, value)
    assert proof.findings == ()
    assert proof.covered == ("a",)
    assert [one.step_id for one in proof.beyond] == ["out", "b"]
    assert proof.beyond[1].why == "nobody can calculate what Flask holds by then"


def test_steps_that_move_no_matter_need_no_proof() -> None:
    value = flow(step("w", "wait", duration="5 s"), step("g", "weigh", balance="@balance_1"))
    assert proof_of(a_bench(), value) == WorkflowProof()
