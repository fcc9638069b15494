"""What a person decides about a job that ended undone, over REST: skip, by hand, other values."""

from __future__ import annotations

import json
from typing import Any

import pytest

from labweb.accounts.models import AuditEntry
from labweb.common.render import iso
from labweb.crutd.models import Entry, Event, ResourceLock
from labweb.crutd.selectors.history_replay import rebuild_differences
from labweb.crutd.selectors.ledger_verification import ledger_violations
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.runs import selectors
from labweb.runs.models import Attempt, Job, Outbox, Run
from tests.builders import Bench, Edge, a_started_run, an_edge, dispatched, to_transfer
from tests.labweb.runs.hosts import last_run
from tests.labweb.web import call, signed_in

NOTHING = Outcome(kind=OutcomeKind.PARTIAL, moved_nl=0)


@pytest.fixture
def edge(bench: Bench) -> Edge:
    return an_edge(bench)


@pytest.fixture
def run(bench: Bench) -> Run:
    return a_started_run(bench)


def fail(edge: Edge, attempt: Attempt, outcome: Outcome = NOTHING) -> Job:
    """Have an action end undone; by default nothing has moved."""
    edge.act(attempt)
    body = {**edge.settled(attempt, outcome), "code": "device.stuck", "message": "it is stuck"}
    edge.report("aborted", attempt.id, **body)
    return Job.objects.get(pk=attempt.job_id)


def choose(bench: Bench, job: Job, who: str = "chemist", **choice: object) -> tuple[int, Any]:
    path = f"/api/v1/jobs/{job.id}/recover"
    answer = call(signed_in(bench.people[who]), "POST", path, {"note": "looked at it", **choice})
    return answer.status_code, json.loads(answer.content)


def card(bench: Bench, job: Job) -> dict[str, Any]:
    path = f"/api/v1/runs/{job.run_id}"
    run = signed_in(bench.people["chemist"]).get(path).json()
    found: dict[str, Any] = next(one for one in run["jobs"] if one["id"] == str(job.id))["recovery"]
    return found


def resume(bench: Bench, run: Run) -> int:
    path = f"/api/v1/runs/{run.id}/resume"
    return call(signed_in(bench.people["chemist"]), "POST", path, {}).status_code


def may(bench: Bench, run: Run, who: str = "chemist") -> dict[str, bool]:
    path = f"/api/v1/runs/{run.id}"
    found: dict[str, bool] = signed_in(bench.people[who]).get(path).json()["can"]
    return found


def volume_nl(bench: Bench, key: str) -> int:
    path = f"/api/v1/resources/{bench.node(key).id}"
    return int(signed_in(bench.people["chemist"]).get(path).json()["volume_nl"])


def is_sound(bench: Bench) -> bool:
    return ledger_violations(bench.lab) == [] and rebuild_differences(bench.lab) == []


def test_a_skipped_job_takes_the_rest_of_its_step_along_and_moves_nothing(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = fail(edge, to_transfer(run, edge))
    behind = [one.sentence for one in Job.objects.filter(run=run, index__gt=job.index)]
    assert card(bench, job)["skips"] == behind
    before, entries = volume_nl(bench, "water"), Entry.objects.count()
    assert resume(bench, run) == 409, "nobody has said what becomes of it"
    call(signed_in(bench.people["chemist"]), "POST", f"/api/v1/runs/{run.id}/pause", {})
    assert may(bench, run)["resume"] is False, "a button that would be refused"
    assert may(bench, run, "approver")["pause"] is True, "another person may pause it, too"
    status, told = choose(bench, job, choice="skip")
    assert status == 200, told
    states = dict(Job.objects.filter(run=run).values_list("index", "state"))
    passed = set(Job.objects.filter(run=run, passed_by="skip").values_list("index", flat=True))
    assert passed == {index for index in states if index >= job.index}
    assert {states[index] for index in passed} == {"aborted", "stopped"}
    assert (volume_nl(bench, "water"), Entry.objects.count()) == (before, entries)
    assert not ResourceLock.objects.filter(released_at__isnull=True).exists()
    kept = Run.objects.get(pk=run.pk).recoveries
    assert [(one["choice"], one["note"], one["by"]) for one in kept] == [
        ("skip", "looked at it", bench.people["chemist"].printed_name)
    ]
    assert AuditEntry.objects.filter(action="job.recover", subject=str(job.id)).count() == 1
    assert Run.objects.get(pk=run.pk).state == "complete", "nothing is left to resume"
    assert is_sound(bench)


def test_the_list_of_workflows_tells_that_a_run_waits_for_recovery_until_it_is_decided(
    bench: Bench, run: Run, edge: Edge
) -> None:
    assert last_run(bench, run)["waits_for"] is None
    job = fail(edge, to_transfer(run, edge))
    assert last_run(bench, run)["waits_for"] == "recovery"
    assert choose(bench, job, choice="skip")[0] == 200
    assert last_run(bench, run)["waits_for"] is None


def test_the_list_of_workflows_tells_that_a_run_waits_for_an_answer(
    bench: Bench, run: Run, edge: Edge
) -> None:
    attempt = to_transfer(run, edge)
    edge.act(attempt)
    edge.report("in_doubt", attempt.id, code="device.timeout", message="no answer")
    assert last_run(bench, run)["waits_for"] == "answer"


def test_what_was_done_by_hand_is_in_the_record_with_its_amount_and_the_run_goes_on(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = fail(edge, to_transfer(run, edge))
    asked_ul = card(bench, job)["asked_ul"]
    assert asked_ul == job.operation["amount_nl"] / 1000
    before, sent = volume_nl(bench, "water"), Outbox.objects.count()
    status, told = choose(bench, job, choice="done_by_hand", moved_ul=asked_ul)
    assert status == 200, told
    assert before - volume_nl(bench, "water") == job.operation["amount_nl"]
    assert Outbox.objects.count() == sent, "nothing is sent to a device"
    event = Event.objects.filter(name="transfer").latest("seq")
    assert event.body["job_id"] is None, "a person did it"
    job.refresh_from_db()
    assert (job.state, job.passed_by) == ("aborted", "hand")
    assert Run.objects.get(pk=run.pk).state == "paused"
    assert resume(bench, run) == 200
    edge.work_off(run)
    assert Run.objects.get(pk=run.pk).state == "complete"
    assert is_sound(bench)
    assert choose(bench, job, choice="skip")[1]["code"] in {"run.ended", "run.recovered"}


def test_less_done_by_hand_than_was_asked_is_written_as_that_and_no_more(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = fail(edge, to_transfer(run, edge))
    before = volume_nl(bench, "water")
    assert choose(bench, job, choice="done_by_hand", moved_ul=1250.5)[0] == 200
    assert before - volume_nl(bench, "water") == 1_250_500
    assert is_sound(bench)


def test_what_a_device_moved_before_it_failed_is_told_and_never_written_twice(
    bench: Bench, run: Run, edge: Edge
) -> None:
    attempt = to_transfer(run, edge)
    before = volume_nl(bench, "water")
    asked_nl = attempt.job.operation["amount_nl"]
    job = fail(edge, attempt, Outcome(kind=OutcomeKind.PARTIAL, moved_nl=asked_nl))
    shown = card(bench, job)
    assert shown["moved_ul"] == shown["asked_ul"] == asked_nl / 1000
    hand = next(one for one in shown["choices"] if one["name"] == "done_by_hand")
    assert "adds the amount" in hand["consequence"]
    entries = Entry.objects.count()
    assert choose(bench, job, choice="done_by_hand", moved_ul=0)[0] == 200
    assert (before - volume_nl(bench, "water"), Entry.objects.count()) == (asked_nl, entries)
    assert resume(bench, run) == 200
    edge.work_off(run)
    assert Run.objects.get(pk=run.pk).state == "complete"
    assert is_sound(bench)


@pytest.mark.parametrize(
    ("choice", "code"),
    [
        ({"choice": "skip", "moved_ul": 5}, "run.bad_amount"),
        ({"choice": "retry", "params": {"volume": "2 mL"}}, "run.bad_choice"),
        ({"choice": "done_by_hand"}, "run.bad_amount"),
        ({"choice": "done_by_hand", "moved_ul": 0}, "run.bad_amount"),
        ({"choice": "done_by_hand", "moved_ul": -5}, "run.bad_amount"),
        ({"choice": "done_by_hand", "moved_ul": 0.0001}, "run.bad_amount"),
        ({"choice": "done_by_hand", "moved_ul": 9e6}, "crutd.insufficient_volume"),
        ({"choice": "change", "params": {"volume": "2 mL"}}, "run.not_offered"),
        ({"choice": "skip", "note": " "}, "run.note_missing"),
        ({"choice": "forget"}, "run.bad_choice"),
    ],
)
def test_a_choice_that_cannot_be_is_refused_and_changes_nothing(
    bench: Bench, run: Run, edge: Edge, choice: dict[str, Any], code: str
) -> None:
    job = fail(edge, to_transfer(run, edge))
    before = (volume_nl(bench, "water"), Entry.objects.count(), Event.objects.count())
    status, told = choose(bench, job, **choice)
    assert status in {409, 412, 422}, told
    assert told["code"] == code
    assert (volume_nl(bench, "water"), Entry.objects.count(), Event.objects.count()) == before
    job.refresh_from_db()
    assert (job.state, job.passed_by) == ("aborted", "")
    assert Run.objects.get(pk=run.pk).recoveries == []
    assert card(bench, job) is not None


def test_who_may_not_run_things_decides_nothing(bench: Bench, run: Run, edge: Edge) -> None:
    job = fail(edge, to_transfer(run, edge))
    assert choose(bench, job, who="observer", choice="skip")[0] == 403
    assert Run.objects.get(pk=run.pk).recoveries == []


def test_a_second_try_of_what_has_poured_a_part_is_not_offered(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = fail(edge, to_transfer(run, edge), Outcome(kind=OutcomeKind.PARTIAL, moved_nl=1_000_000))
    offered = {one["name"]: one["why_not"] for one in card(bench, job)["choices"]}
    assert "a part has moved" in offered["retry"]
    assert (offered["skip"], offered["done_by_hand"]) == (None, None)
    assert choose(bench, job, choice="retry")[1]["code"] == "run.not_offered"


def test_nothing_is_poured_by_hand_for_a_job_that_pours_nothing(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = fail(edge, dispatched(run))
    assert job.operation["op"] != "transfer_liquid"
    assert card(bench, job)["asked_ul"] is None
    refused = choose(bench, job, choice="done_by_hand", moved_ul=5)
    assert (refused[0], refused[1]["code"]) == (422, "run.bad_amount")
    before = volume_nl(bench, "water")
    assert choose(bench, job, choice="done_by_hand")[0] == 200
    assert volume_nl(bench, "water") == before
    assert choose(bench, job, choice="skip")[1]["code"] == "run.recovered"


def test_a_step_with_other_values_is_planned_anew_and_moves_those(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = fail(edge, dispatched(run))
    before = volume_nl(bench, "water")
    old = set(Job.objects.filter(run=run).values_list("id", flat=True))
    old_digest = Run.objects.get(pk=run.pk).plan_digest
    assert "volume" in card(bench, job)["params"]
    status, told = choose(bench, job, choice="change", params={"volume": "2 mL"})
    assert status == 200, told
    assert set(Job.objects.filter(run=run, passed_by="change").values_list("id", flat=True)) == old
    made = Job.objects.filter(run=run).exclude(id__in=old)
    assert set(made.values_list("state", flat=True)) == {"held"}
    entry = Run.objects.get(pk=run.pk).recoveries[0]
    assert (entry["params"], entry["plan_before"]) == ({"volume": "2 mL"}, old_digest)
    assert entry["before"]["volume"] != "2 mL"
    assert Run.objects.get(pk=run.pk).plan_digest == entry["plan_after"] != old_digest
    assert resume(bench, run) == 200
    edge.work_off(run)
    assert Run.objects.get(pk=run.pk).state == "complete"
    assert before - volume_nl(bench, "water") == 2_000_000
    assert is_sound(bench)


@pytest.mark.parametrize("params", [{}, {"volume": "9 L"}, {"volume": "much"}, {"colour": "red"}])
def test_values_that_cannot_be_planned_leave_the_run_as_it_was(
    bench: Bench, run: Run, edge: Edge, params: dict[str, str]
) -> None:
    job = fail(edge, dispatched(run))
    jobs, digest = Job.objects.filter(run=run).count(), Run.objects.get(pk=run.pk).plan_digest
    status, told = choose(bench, job, choice="change", params=params)
    assert status == 422, told
    after = Run.objects.get(pk=run.pk)
    assert (Job.objects.filter(run=run).count(), after.plan_digest) == (jobs, digest)
    assert (after.recoveries, card(bench, job)["tries"]) == ([], 1)


def in_doubt(edge: Edge, run: Run) -> Job:
    """Have an action be in doubt."""
    attempt = dispatched(run)
    edge.lose(attempt)
    return Job.objects.get(pk=attempt.job_id)


def answered(bench: Bench, job: Job, answer: str) -> dict[str, Any]:
    path = f"/api/v1/jobs/{job.id}/resolve"
    wish = {"answer": answer, "note": "looked at it"}
    told = call(signed_in(bench.people["admin"]), "POST", path, wish)
    found: dict[str, Any] = json.loads(told.content)
    return found


def test_an_answer_to_one_doubt_is_no_evidence_of_the_next(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = in_doubt(edge, run)
    answered(bench, job, "did_not")
    edge.resolve(Attempt.objects.get(job=job))
    job.refresh_from_db()
    assert job.evidence["resolution"]["answer"] == "did_not"
    assert choose(bench, job, choice="retry")[0] == 200
    assert resume(bench, run) == 200
    again = in_doubt(edge, run)
    assert (again.pk, again.attempts.count()) == (job.pk, 2)
    assert "resolution" not in again.evidence


def test_that_a_try_was_given_up_in_doubt_stays_with_the_job_when_it_is_tried_again(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = in_doubt(edge, run)
    Job.objects.filter(pk=job.pk).update(recovery="R1")
    answered(bench, job, "discard")
    edge.resolve(Attempt.objects.get(job=job))
    assert choose(bench, job, choice="retry")[0] == 200
    job.refresh_from_db()
    assert "resolution" not in job.evidence
    assert selectors.recovery.is_discarded(job)
    assert not selectors.recovery.is_step_untouched(job)


def test_who_has_answered_a_doubt_and_when_is_shown_before_the_host_has_heard(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = in_doubt(edge, run)
    path = f"/api/v1/runs/{run.id}"
    name = bench.people["admin"].printed_name
    told = answered(bench, job, "happened")["question"]
    sent = Outbox.objects.get(kind="resolve")
    assert (told["answer_sent"], told["answered_by"]) == (True, name)
    shown = signed_in(bench.people["chemist"]).get(path).json()["jobs"][job.index]["question"]
    assert shown == told
    assert shown["answered_at"] == iso(sent.at)
