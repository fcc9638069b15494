"""What a person confirms, and what a person weighs in, as jobs of a plan."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from msgspec.structs import replace

from labweb.domain.crutd.operations import TransferMass
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.resources.contents_by_lot import Phase
from labweb.domain.workflows.compile_workflow import compile_workflow
from labweb.domain.workflows.plan import Plan, PlannedJob, encode
from labweb.domain.workflows.plan_proof.prove_workflow import prove_plan
from tests.domain.workflows.solids import filter_raw, on, steps
from tests.domain.workflows.station import view_of

WEIGHED = ("add_solid", {"source": "@crude", "target": "@separator", "mass": "2 g"})
ASKED = ("confirm", {"question": "Is the stopcock closed?"})


def a_jar(*lots: str) -> bytes:
    """Return the station with a flask that holds solids and no liquid."""
    plain = json.loads(filter_raw(is_plain=True))
    (jar,) = (one for one in plain["resources"] if one["key"] == "crude")
    jar["config"]["capacity_mg"] = 100_000
    jar["masses"] = [{"lot": lot, "amount_mg": 5_000} for lot in lots]
    return json.dumps(plain).encode()


LAB = read_lab(a_jar("salt"))


def planned(*made: tuple[str, dict[str, Any]]) -> Plan:
    return compile_workflow(on(steps(*made), LAB), view_of(LAB, {}))


def test_a_question_is_a_job_that_waits_for_a_person_and_moves_nothing() -> None:
    (job,) = planned(ASKED).jobs
    assert (job.asks, job.sentence) == (
        "Is the stopcock closed?",
        "Ask a person: Is the stopcock closed?",
    )
    assert (job.action, job.args) == ("wait", {"duration_s": 0.0})
    proof = prove_plan(on(steps(ASKED), LAB), planned(ASKED), view_of(LAB, {}))
    assert not proof.findings
    assert not proof.beyond


def test_a_solid_is_weighed_in_by_hand_booked_by_mass_and_proved() -> None:
    plan = planned(WEIGHED)
    (job,) = plan.jobs
    assert isinstance(job.operation, TransferMass)
    assert (job.operation.amount_ug, job.operation.phase) == (2_000_000, Phase.SOLID)
    assert "Weigh 2 g from" in str(job.asks)
    assert set(job.locks) >= {job.operation.source_id, job.operation.target_id}
    proof = prove_plan(on(steps(WEIGHED), LAB), plan, view_of(LAB, {}))
    assert not proof.findings
    assert proof.covered == ("s0",)


def test_more_than_is_there_is_refused_before_anybody_is_asked() -> None:
    heavy = ("add_solid", {**WEIGHED[1], "mass": "6 g"})
    with pytest.raises(Exception, match="holds 5000 mg"):
        planned(heavy)


def test_of_two_solids_in_one_jar_no_proof_says_which_is_weighed() -> None:
    lab = read_lab(a_jar("salt", "sand"))
    workflow = on(steps(WEIGHED), lab)
    view = view_of(lab, {})
    proof = prove_plan(workflow, compile_workflow(workflow, view), view)
    assert [one.step_id for one in proof.beyond] == ["s0"]
    assert "one solid lot alone" in proof.beyond[0].why


def _half(job: PlannedJob) -> PlannedJob:
    assert isinstance(job.operation, TransferMass)
    return replace(job, operation=replace(job.operation, amount_ug=1_000_000))


def _turned(job: PlannedJob) -> PlannedJob:
    assert isinstance(job.operation, TransferMass)
    ends = {"source_id": job.operation.target_id, "target_id": job.operation.source_id}
    return replace(job, operation=replace(job.operation, **ends))


@pytest.mark.parametrize("spoil", [_half, _turned])
def test_a_mass_or_a_vessel_that_nobody_asked_for_is_not_proved(
    spoil: Callable[[PlannedJob], PlannedJob],
) -> None:
    plan = planned(WEIGHED)
    wrong = replace(plan, jobs=tuple(spoil(job) for job in plan.jobs))
    proof = prove_plan(on(steps(WEIGHED), LAB), wrong, view_of(LAB, {}))
    assert {one.code for one in proof.findings} == {"plan.not_proved"}


def test_a_plan_that_asks_nobody_is_written_as_before() -> None:
    wait = ("wait", {"duration": "5 s"})
    assert b"asks" not in encode(planned(wait))


def test_a_question_too_long_for_a_job_is_refused() -> None:
    with pytest.raises(Exception, match="Question is one line of 1 to 200 characters"):
        on(steps(("confirm", {"question": "x" * 201})), LAB)
