"""What a person decides about a run of a recipe is compared with what was proved."""

from __future__ import annotations

import json
from typing import Any

import pytest

from labweb.accounts.models import AuditEntry
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.resources.models import Resource
from labweb.runs.models import Job, Run
from labweb.runs.services import resolve_job, start_run
from tests.builders import Bench, Edge, a_started_run, an_edge, dispatched, to_transfer
from tests.labweb.crutd.hand import done, nl
from tests.labweb.crutd.test_by_hand_stock import correction, lot_of
from tests.labweb.runs.test_recovery import choose, fail
from tests.labweb.web import call, signed_in
from tests.labweb.workflows.asking import kept

PART = Outcome(kind=OutcomeKind.PARTIAL, moved_nl=1_000_000)


@pytest.fixture
def edge(bench: Bench) -> Edge:
    return an_edge(bench)


@pytest.fixture
def run(bench: Bench) -> Run:
    chemist = bench.people["chemist"]
    return start_run(kept(signed_in(chemist)), actor=chemist)


def shown(bench: Bench, run: Run) -> dict[str, Any]:
    answer = signed_in(bench.people["chemist"]).get(f"/api/v1/runs/{run.id}")
    found: dict[str, Any] = json.loads(answer.content)["proof"]
    return found


def resumed(bench: Bench, run: Run, **body: object) -> tuple[int, dict[str, Any]]:
    client = signed_in(bench.people["chemist"])
    answer = call(client, "POST", f"/api/v1/runs/{run.id}/resume", body)
    return answer.status_code, json.loads(answer.content)


def test_a_second_try_leaves_the_proof_and_goes_on(bench: Bench, run: Run, edge: Edge) -> None:
    job = fail(edge, dispatched(run))
    assert choose(bench, job, choice="retry")[0] == 200
    assert shown(bench, run)["departures"] == []
    assert resumed(bench, run)[0] == 200


def test_what_was_done_by_hand_as_planned_leaves_the_proof(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = fail(edge, to_transfer(run, edge), PART)
    rest_ul = (job.operation["amount_nl"] - PART.moved_nl) / 1000
    assert choose(bench, job, choice="done_by_hand", moved_ul=rest_ul)[0] == 200
    assert shown(bench, run)["departures"] == []
    assert resumed(bench, run)[0] == 200


def test_another_amount_by_hand_is_told_and_holds_the_run(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = fail(edge, to_transfer(run, edge), PART)
    assert choose(bench, job, choice="done_by_hand", moved_ul=500)[0] == 200
    (told,) = shown(bench, run)["departures"]
    assert told["place"] == str(job.id)
    assert "1.5 mL were moved" in told["text"] or "1.50 mL were moved" in told["text"]
    status, refusal = resumed(bench, run)
    assert (status, refusal["code"]) == (412, "recipe.deviated")
    assert [one["message"] for one in refusal["findings"]] == [told["text"]]
    assert Run.objects.get(pk=run.pk).state == "paused"


def given_up(bench: Bench, run: Run, edge: Edge) -> Job:
    """Lose a pour, answer that nobody knows, and find that half of it was moved."""
    attempt = to_transfer(run, edge)
    operation = attempt.job.operation
    ends = [Resource.objects.get(pk=operation[end]).key for end in ("source_id", "target_id")]
    lot, before = lot_of(bench, ends[0]), [nl(bench, end) for end in ends]
    edge.lose(attempt)
    resolve_job(
        attempt.job_id, actor=bench.people["chemist"], answer="discard", moved_nl=None, note="?"
    )
    edge.resolve(attempt)
    half = operation["amount_nl"] // 2
    for end, there, change in zip(ends, before, (-half, half), strict=True):
        stock = correction(bench, end, account="SUSPENSE", measured_nl={lot: there + change})
        done(bench, stock)
    return Job.objects.get(pk=attempt.job_id)


def test_after_a_try_that_was_given_up_nothing_by_hand_is_as_planned(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = given_up(bench, run, edge)
    for choice in ({"choice": "retry"}, {"choice": "change", "params": {"volume": "4 mL"}}):
        status, refusal = choose(bench, job, **choice)
        assert (status, refusal["code"]) == (409, "run.not_offered")
    asked_ul = job.operation["amount_nl"] / 1000
    assert choose(bench, job, choice="done_by_hand", moved_ul=asked_ul)[0] == 200
    (told,) = shown(bench, run)["departures"]
    assert told["text"] == f"what {job.sentence!r} moved up to its try 1 is not known"
    assert resumed(bench, run)[1]["code"] == "recipe.deviated"
    assert resumed(bench, run, departures=[told])[0] == 200


def test_a_set_point_that_was_given_up_is_tried_again_and_told(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = given_up(bench, run, edge)
    Job.objects.filter(pk=job.pk).update(recovery="R1")
    assert choose(bench, job, choice="retry")[0] == 200
    (told,) = shown(bench, run)["departures"]
    assert told["text"] == f"what {job.sentence!r} moved up to its try 1 is not known"
    assert resumed(bench, run)[1]["code"] == "recipe.deviated"


def test_a_run_goes_on_without_its_proof_once_a_person_says_so(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = fail(edge, to_transfer(run, edge))
    assert choose(bench, job, choice="skip")[0] == 200
    told = shown(bench, run)["departures"]
    assert told == [{"place": str(job.id), "text": f"{job.sentence!r} was skipped"}]
    other, refusal = resumed(bench, run, departures=[{"place": "", "text": "something else"}])
    assert (other, refusal["code"]) == (409, "recipe.deviated_since")
    assert resumed(bench, run, departures=told)[0] == 200
    found = shown(bench, run)
    assert (found["accepted"], found["by"]) == (told, bench.people["chemist"].printed_name)
    entry = AuditEntry.objects.filter(action="run.resume").latest("at")
    assert entry.detail == {"departures": told}


def test_what_was_accepted_does_not_let_the_next_departure_pass(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = fail(edge, dispatched(run))
    assert choose(bench, job, choice="change", params={"volume": "4 mL"})[0] == 200
    (told,) = shown(bench, run)["departures"]
    assert "volume 2 mL became 4 mL" in told["text"]
    assert resumed(bench, run, departures=[told])[0] == 200
    again = fail(edge, dispatched(run))
    assert choose(bench, again, choice="skip")[0] == 200
    assert resumed(bench, run)[1]["code"] == "recipe.deviated"


def test_other_words_for_the_same_value_and_a_change_taken_back_leave_the_proof(
    bench: Bench, run: Run, edge: Edge
) -> None:
    step = run.version.document["steps"][0]["params"]["volume"]
    job = fail(edge, dispatched(run))
    assert choose(bench, job, choice="change", params={"volume": "4 mL"})[0] == 200
    assert shown(bench, run)["departures"]
    assert resumed(bench, run)[1]["code"] == "recipe.deviated"
    run.refresh_from_db()
    held = Job.objects.filter(run=run, passed_by="").order_by("index")[0]
    assert held.state == "held"
    assert resumed(bench, run, departures=shown(bench, run)["departures"])[0] == 200
    job = fail(edge, dispatched(run))
    assert choose(bench, job, choice="change", params={"volume": step})[0] == 200
    assert shown(bench, run)["departures"] == []
    assert resumed(bench, run)[0] == 200


def test_a_run_of_what_was_drawn_speaks_of_no_proof(bench: Bench) -> None:

    assert shown(bench, a_started_run(bench)) is None
