"""A whole synthesis is carried out on paper: what reacts, what parts, and what boils off."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest
from msgspec.structs import replace

from labweb.domain.crutd.operations import Operation, React, TransferLiquid
from labweb.domain.workflows.compile_workflow import compile_workflow
from labweb.domain.workflows.plan import Plan, PlannedJob
from labweb.domain.workflows.plan_proof.prove_workflow import WorkflowProof, prove_plan
from labweb.domain.workflows.plan_proof.step_claims import NOT_PROVED
from labweb.domain.workflows.workflow_file import Workflow
from tests.domain.workflows.station import recipe_document, station, workflow

MATTER = ("transfer", "separate", "push_gas", "react", "evaporate")
Mutant = Callable[[Plan], Plan]


@cache
def recipe() -> Workflow:
    return workflow(recipe_document())


@cache
def plan() -> Plan:
    return compile_workflow(recipe(), station())


def step_id(kind: str, place: int = 0) -> str:
    return [one.step_id for one in plan().steps if one.kind == kind][place]


def proof_of(mutant: Mutant = lambda plan: plan) -> WorkflowProof:
    return prove_plan(recipe(), mutant(plan()), station())


def at(kind: str, change: Callable[[Operation], Operation], place: int = 0) -> Mutant:
    """Change what is booked by the jobs of one step that book anything."""

    def changed(job: PlannedJob) -> PlannedJob:
        is_it = job.step_id == step_id(kind, place)
        is_it = is_it and isinstance(job.operation, React | TransferLiquid)
        return replace(job, operation=change(job.operation)) if is_it else job

    return lambda plan: replace(plan, jobs=tuple(changed(job) for job in plan.jobs))


def less_reacts(operation: Operation) -> Operation:
    assert isinstance(operation, React)
    first, *rest = operation.reactants
    half = replace(first, amount_nl=first.amount_nl // 2, amount_ug=first.amount_ug // 2)
    return replace(operation, reactants=(half, *rest))


def more_is_made(operation: Operation) -> Operation:
    assert isinstance(operation, React)
    made = [
        replace(one, amount_nl=one.amount_nl + 1_000_000) if one.amount_nl else one
        for one in operation.products
    ]
    return replace(operation, products=tuple(made))


def half_boils_off(operation: Operation) -> Operation:
    assert isinstance(operation, TransferLiquid)
    parts = {lot: nl // 2 for lot, nl in operation.parts_nl.items()}
    return replace(operation, parts_nl=parts, amount_nl=sum(parts.values()))


def back_into_itself(operation: Operation) -> Operation:
    assert isinstance(operation, TransferLiquid)
    return replace(operation, target_id=operation.source_id)


def another_layer(operation: Operation) -> Operation:
    assert isinstance(operation, TransferLiquid)
    if not operation.parts_nl:
        return operation
    return replace(operation, parts_nl={"no such lot": sum(operation.parts_nl.values())})


def without(kind: str) -> Mutant:
    gone = step_id(kind)
    return lambda plan: replace(
        plan,
        jobs=tuple(
            job
            for job in plan.jobs
            if job.step_id != gone or not isinstance(job.operation, React | TransferLiquid)
        ),
    )


MUTANTS: dict[str, Callable[[], Mutant]] = {
    "a reaction is not recorded": lambda: without("react"),
    "less reacts than is stated": lambda: at("react", less_reacts),
    "more is made than is stated": lambda: at("react", more_is_made),
    "nothing is recorded of an evaporation": lambda: without("evaporate"),
    "half boils off of what is stated": lambda: at("evaporate", half_boils_off),
    "it condenses in its own flask": lambda: at("evaporate", back_into_itself),
    "another layer is drawn": lambda: at("separate", another_layer),
    "no layer is drawn": lambda: without("separate"),
}


def test_every_step_of_a_synthesis_that_changes_matter_is_proved() -> None:
    proof = proof_of()
    assert proof.findings == ()
    assert proof.beyond == ()
    wanted = [one.step_id for one in plan().steps if one.kind in MATTER]
    assert list(proof.covered) == wanted
    assert {one.kind for one in plan().steps} >= {"react", "separate", "evaporate"}


@pytest.mark.parametrize("name", MUTANTS)
def test_one_fault_about_matter_is_refused(name: str) -> None:
    proof = proof_of(MUTANTS[name]())
    assert proof.findings
    assert {one.code for one in proof.findings} == {NOT_PROVED}
