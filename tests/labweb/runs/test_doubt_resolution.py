"""A person answers a doubt: with the reading, against it, with what follows, and for good."""

from __future__ import annotations

import json
from typing import Any
from uuid import uuid4

import pytest

from labweb.accounts.models import AuditEntry
from labweb.crutd.models import Holding, Ticket
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.resources.models import Resource
from labweb.runs import services
from labweb.runs.models import Attempt, HostEvent, Job, Outbox, Run
from labweb.telemetry.models import Sample
from tests.builders import Bench, Edge, a_started_run, an_edge, to_transfer
from tests.labweb.web import call, signed_in

UNKNOWN = Outcome(kind=OutcomeKind.UNKNOWN)


@pytest.fixture
def edge(bench: Bench) -> Edge:
    return an_edge(bench)


@pytest.fixture
def run(bench: Bench) -> Run:
    return a_started_run(bench)


def lost(
    edge: Edge, attempt: Attempt, *, before_ul: float | None = 0.0, after_ul: float | None = None
) -> Job:
    """Begin to aspirate and not know how far it came; tell where the plunger stands since."""
    job = attempt.job
    readings = [] if before_ul is None else [[str(job.device_id), "volume_ul", before_ul]]
    edge.report("accepted", attempt.id)
    edge.report("started", attempt.id, pid=1, prestate={"readings": readings})
    body = edge.settled(attempt, UNKNOWN)
    edge.report("in_doubt", attempt.id, **body, code="device.timeout", message="no answer")
    if after_ul is not None:
        for at in (2.0, 3.0, 4.0):
            Sample.objects.create(
                device_id=job.device_id, status="volume_ul", at=at, value=after_ul
            )
    return Job.objects.get(pk=job.pk)


def shown(bench: Bench, job: Job) -> dict[str, Any]:
    run = signed_in(bench.people["chemist"]).get(f"/api/v1/runs/{job.run_id}").json()
    found: dict[str, Any] = next(one for one in run["jobs"] if one["id"] == str(job.id))
    return found


def answer(bench: Bench, job: Job, answer: str, **fields: Any) -> tuple[int, dict[str, Any]]:  # noqa: ANN401
    path = f"/api/v1/jobs/{job.id}/resolve"
    wish = {"answer": answer, "note": "read the scale", **fields}
    told = call(signed_in(bench.people["chemist"]), "POST", path, wish)
    found: dict[str, Any] = json.loads(told.content)
    return told.status_code, found


def resolved(bench: Bench, edge: Edge, job: Job, said: str, **fields: Any) -> Job:  # noqa: ANN401
    """Answer, and have the host settle it."""
    status, told = answer(bench, job, said, **fields)
    assert status == 200, told
    edge.resolve(Attempt.objects.filter(job=job).latest("number"))
    return Job.objects.get(pk=job.pk)


def test_the_question_shows_the_subtraction_and_the_answer_that_agrees(
    bench: Bench, run: Run, edge: Edge
) -> None:
    attempt = to_transfer(run, edge)
    question = shown(bench, lost(edge, attempt, after_ul=3_500.0))["question"]
    assert question["attempt_id"] == str(attempt.id)
    assert question["measured"] == {
        "text": "The plunger stood at 0.000 mL before and stands at 3.500 mL now: "
        "3.500 \N{MINUS SIGN} 0.000 = 3.500 mL moved.",
        "before_ul": 0.0,
        "after_ul": 3500.0,
        "moved_ul": 3500.0,
        "tolerance_ul": pytest.approx(question["measured"]["tolerance_ul"]),
        "answer": "partly",
        "contradicts": ["happened", "did_not"],
    }
    assert [one["name"] for one in question["then"]["did_not"]] == ["retry", "done_by_hand", "skip"]


@pytest.mark.parametrize(
    ("before_ul", "after_ul", "missing"),
    [(None, 3_500.0, "before is missing"), (0.0, None, "now is missing: Pump 1 has not told it")],
)
def test_the_question_names_the_reading_that_is_missing_and_offers_no_answer(
    bench: Bench,
    run: Run,
    edge: Edge,
    before_ul: float | None,
    after_ul: float | None,
    missing: str,
) -> None:
    job = lost(edge, to_transfer(run, edge), before_ul=before_ul, after_ul=after_ul)
    measured = shown(bench, job)["question"]["measured"]
    assert missing in measured["text"]
    assert (measured["moved_ul"], measured["answer"], measured["contradicts"]) == (None, None, [])
    assert answer(bench, job, "happened")[0] == 200, "nothing contradicts it"


def test_a_plunger_that_still_moves_tells_nothing_yet(bench: Bench, run: Run, edge: Edge) -> None:
    job = lost(edge, to_transfer(run, edge), after_ul=3_500.0)
    for at, value in [(4.4, 3_600.0), (4.8, 3_700.0)]:
        Sample.objects.create(device_id=job.device_id, status="volume_ul", at=at, value=value)
    measured = shown(bench, job)["question"]["measured"]
    assert "still moves" in measured["text"]
    assert measured["moved_ul"] is None


def test_an_answer_that_the_plunger_contradicts_is_refused_with_both_numbers(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = lost(edge, to_transfer(run, edge), after_ul=3_500.0)
    for said in ({"answer": "happened"}, {"answer": "partly", "moved_ul": 4_000.0}):
        status, told = answer(bench, job, **said)
        assert (status, told["code"]) == (412, "run.contradicts_reading")
        assert "3.500 mL" in told["message"]
        assert told["findings"][0]["context"]["measured_nl"] == 3_500_000
    assert not Outbox.objects.filter(kind="resolve").exists()


def test_an_answer_despite_the_reading_is_taken_and_says_so_for_ever(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = lost(edge, to_transfer(run, edge), after_ul=3_500.0)
    job = resolved(bench, edge, job, "happened", despite_reading=True)
    assert job.state == "complete"
    assert "3.500 mL moved" in job.evidence["resolution"]["despite_reading"]
    entry = AuditEntry.objects.get(action="job.resolve", subject=str(job.id))
    assert "3.500 mL moved" in entry.detail["despite_reading"]


def test_an_answer_that_agrees_needs_no_acknowledgement(bench: Bench, run: Run, edge: Edge) -> None:
    job = lost(edge, to_transfer(run, edge), after_ul=3_500.0)
    job = resolved(bench, edge, job, "partly", moved_ul=3_500.0, despite_reading=True)
    assert "despite_reading" not in job.evidence["resolution"]


def read_since(job: Job, after_ul: float) -> None:
    """Let the device tell where its plunger stands, once it answers again."""
    for at in (12.0, 13.0, 14.0):
        Sample.objects.create(device_id=job.device_id, status="volume_ul", at=at, value=after_ul)


def held_of(bench: Bench) -> dict[str, int]:
    rows = Holding.objects.filter(resource__lab=bench.lab)
    return {f"{row.resource_id} {row.lot_id}": row.amount_nl for row in rows}


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ("happened", "5.000 mL moved from {0} to {1}, and the plunger says 2.500 mL"),
        ("did_not", "nothing moved from {0} to {1}, and the plunger says 2.500 mL"),
    ],
)
def test_a_reading_that_comes_after_the_answer_and_contradicts_it_is_asked_about(
    bench: Bench, run: Run, edge: Edge, said: str, words: str
) -> None:
    job = resolved(bench, edge, lost(edge, to_transfer(run, edge)), said)
    assert services.reread_answers() == 0, "it is not read yet"
    held = held_of(bench)
    read_since(job, 2_500.0)
    assert services.reread_answers() == 1
    names = [Resource.objects.get(pk=job.operation[end]).name for end in ("source_id", "target_id")]
    more, less = names if said == "happened" else reversed(names)
    client = signed_in(bench.people["chemist"])
    needs = client.get("/api/v1/home").json()["needs_you"]
    [need] = [one for one in needs if one["kind"] == "ticket"]
    who = bench.people["chemist"].printed_name
    assert need["title"] == f"Pump 1 reads otherwise than {who} answered before it was read"
    assert words.format(*names) in need["detail"]
    assert f"{more} holds 2.500 mL more than the record says, and {less} 2.500" in need["detail"]
    [card] = client.get(f"/api/v1/runs/{run.id}").json()["contradicted"]
    assert need["url"] == f"/lab?ticket={card['ticket_id']}"
    ticket = client.get(f"/api/v1/tickets/{card['ticket_id']}").json()
    assert {one["name"] for one in ticket["resources"]} == set(names)
    assert held_of(bench) == held, "the record is a person's to correct"
    assert services.reread_answers() == 0, "it is asked once"


def test_a_reading_that_comes_after_the_answer_and_agrees_asks_nobody(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = resolved(bench, edge, lost(edge, to_transfer(run, edge)), "partly", moved_ul=2_500.0)
    read_since(job, 2_500.0)
    assert services.reread_answers() == 0
    assert not Ticket.objects.exists()
    assert "unread" not in Job.objects.get(pk=job.pk).evidence


def test_a_reading_counts_though_the_action_is_tried_again_and_only_until_then(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = resolved(bench, edge, lost(edge, to_transfer(run, edge)), "did_not", then="retry")
    client = signed_in(bench.people["chemist"])
    assert call(client, "POST", f"/api/v1/runs/{run.id}/resume", {}).status_code == 200
    again = to_transfer(run, edge)
    edge.report("accepted", again.id)
    readings = [[str(job.device_id), "volume_ul", 2_500.0]]
    edge.report("started", again.id, pid=1, prestate={"readings": readings})
    started_s = HostEvent.objects.get(action_id=again.id, kind="started").at_s
    Sample.objects.create(device_id=job.device_id, status="volume_ul", at=started_s + 1, value=0.0)
    assert services.reread_answers() == 1
    assert "the plunger says 2.500 mL" in Ticket.objects.get().message


def test_an_answer_to_another_doubt_is_refused(bench: Bench, run: Run, edge: Edge) -> None:
    attempt = to_transfer(run, edge)
    job = lost(edge, attempt)
    status, told = answer(bench, job, "did_not", attempt_id=str(uuid4()))
    assert (status, told["code"]) == (409, "run.other_doubt")
    resolved(bench, edge, job, "did_not", attempt_id=str(attempt.id), then="retry")
    client = signed_in(bench.people["chemist"])
    assert call(client, "POST", f"/api/v1/runs/{run.id}/resume", {}).status_code == 200
    again = to_transfer(run, edge)
    assert again.job_id == job.pk
    lost(edge, again)
    for about in ({"attempt_id": str(attempt.id)}, {}):
        status, told = answer(bench, job, "did_not", **about)
        assert (status, told["code"]) == (409, "run.other_doubt")
    assert answer(bench, job, "did_not", attempt_id=str(again.id))[0] == 200


def test_what_follows_an_answer_is_done_as_soon_as_the_host_has_settled_it(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = lost(edge, to_transfer(run, edge))
    job = resolved(bench, edge, job, "did_not", then="skip")
    assert (job.state, job.passed_by) == ("aborted", "skip")
    assert [one["choice"] for one in Run.objects.get(pk=run.pk).recoveries] == ["skip"]


def test_a_run_may_be_aborted_with_the_answer(bench: Bench, run: Run, edge: Edge) -> None:
    job = resolved(bench, edge, lost(edge, to_transfer(run, edge)), "did_not", then="abort")
    assert job.state == "aborted"
    assert Run.objects.get(pk=run.pk).state == "aborted"


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"answer": "happened", "then": "retry"}, "run.bad_choice"),
        ({"answer": "did_not", "then": "dance"}, "run.bad_choice"),
        ({"answer": "did_not", "then": "done_by_hand"}, "run.bad_amount"),
        ({"answer": "did_not", "then": "skip", "then_moved_ul": 5.0}, "run.bad_amount"),
        ({"answer": "partly", "moved_ul": 100.0, "then": "retry"}, "run.not_offered"),
    ],
)
def test_what_cannot_follow_an_answer_is_refused_and_nothing_is_sent(
    bench: Bench, run: Run, edge: Edge, fields: dict[str, Any], code: str
) -> None:
    job = lost(edge, to_transfer(run, edge))
    status, told = answer(bench, job, **fields)
    assert (status // 100, told["code"]) == (4, code)
    assert not Outbox.objects.filter(kind="resolve").exists()
    assert "then" not in Job.objects.get(pk=job.pk).evidence


def test_a_resolved_doubt_reads_as_resolved_wherever_it_stands(
    bench: Bench, run: Run, edge: Edge
) -> None:
    job = resolved(bench, edge, lost(edge, to_transfer(run, edge)), "partly", moved_ul=2_000.0)
    client = signed_in(bench.people["chemist"])
    name = bench.people["chemist"].printed_name
    text = f"Resolved by {name}: partly, 2.000 mL moved"

    def all_of(path: str, key: str) -> list[dict[str, Any]]:
        rows: list[dict[str, Any]] = client.get(f"/api/v1/{path}").json()[key]
        return rows

    vessel = str(bench.node("water").id)
    for rows in (
        all_of(f"runs/{run.id}/events", "events"),
        all_of(f"resources/{vessel}", "events"),
    ):
        [doubt] = [one for one in rows if one["state"] == "quarantined"]
        assert doubt["resolved"]["text"] == text
        assert doubt["resolved"]["note"] == "read the scale"
        assert doubt["resolved"]["doubt_at"] < doubt["resolved"]["at"]
    lines = [one for one in all_of(f"runs/{run.id}/log", "lines") if one["kind"] == "in_doubt"]
    assert [one["resolved"]["text"] for one in lines] == [text]
    assert "in doubt" not in lines[0]["text"]
    report = client.get(f"/api/v1/runs/{run.id}/report").json()
    assert [one["resolved"]["text"] for one in report["doubts"]] == [text]
    told = job.evidence["resolution"]
    assert (told["by"], told["answer"]) == (name, "partly")
    assert told["doubt_at"] < told["at"]
    graph = client.get(f"/api/v1/runs/{run.id}/provenance").json()
    assert text in json.dumps(graph)


def test_a_doubt_that_is_open_reads_as_one(bench: Bench, run: Run, edge: Edge) -> None:
    lost(edge, to_transfer(run, edge))
    client = signed_in(bench.people["chemist"])
    rows = client.get(f"/api/v1/runs/{run.id}/events").json()["events"]
    assert [one["resolved"] for one in rows if one["state"] == "quarantined"] == [None]
    assert [
        one["resolved"] for one in client.get(f"/api/v1/runs/{run.id}/report").json()["doubts"]
    ] == [None]


def test_an_action_that_stayed_unconfirmed_stands_in_report_log_and_events(
    bench: Bench, run: Run, edge: Edge
) -> None:
    attempt = to_transfer(run, edge)
    edge.act(attempt)
    body = edge.settled(attempt, Outcome(kind=OutcomeKind.DONE))
    said = {"code": "edge.unconfirmed", "message": "not confirmed: mass has not settled"}
    edge.report("complete", attempt.id, **{**body, **said, "verification": "unconfirmed"})
    client = signed_in(bench.people["chemist"])
    report = client.get(f"/api/v1/runs/{run.id}/report").json()
    assert [one["message"] for one in report["unconfirmed"]] == [said["message"]]
    events = client.get(f"/api/v1/runs/{run.id}/events").json()["events"]
    assert "unconfirmed" in [one["verification"] for one in events]
    lines = client.get(f"/api/v1/runs/{run.id}/log").json()["lines"]
    assert any(said["message"] in one["text"] for one in lines)
    assert shown(bench, attempt.job)["verification"] == "unconfirmed"
