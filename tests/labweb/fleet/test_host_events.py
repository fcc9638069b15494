"""What becomes of the events of hosts."""

from __future__ import annotations

from functools import partial
from uuid import uuid4

import msgspec
import pytest

from labweb.crutd import selectors as crutd_selectors
from labweb.crutd.models import Entry, Event, Holding, ResourceLock, Ticket
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.errors import DefinitionError, StateError
from labweb.enrollment import services as enrollment_services
from labweb.fleet.services import host_events
from labweb.resources.models import Resource
from labweb.runs import services
from labweb.runs.models import Attempt, HostEvent, Job, Run
from labweb.runs.selectors import lab_summary
from labweb.runs.services.host_tickets import MOST_ALIKE
from tests.builders import (
    HEAT,
    Bench,
    Edge,
    a_started_run,
    an_edge,
    dispatched,
    public_half,
    to_transfer,
)


def held_nl(bench: Bench, key: str) -> int:
    rows = Holding.objects.filter(resource=bench.node(key))
    return sum(rows.values_list("amount_nl", flat=True))


def locks_of(attempt: Attempt) -> int:
    rows = ResourceLock.objects.filter(transaction=attempt.transaction)
    return rows.filter(released_at__isnull=True).count()


def test_a_run_whose_jobs_are_all_carried_out_is_complete(bench: Bench) -> None:
    run = a_started_run(bench)
    water, reactor = held_nl(bench, "water"), held_nl(bench, "reactor_1")
    an_edge(bench).work_off(run)
    run.refresh_from_db()
    assert run.state == "complete"
    assert held_nl(bench, "water") == water - 5_000_000
    assert held_nl(bench, "reactor_1") == reactor + 5_000_000
    assert not Ticket.objects.exists()
    assert set(crutd_selectors.balance_by_lot(bench.lab).values()) == {0}
    assert not ResourceLock.objects.filter(released_at__isnull=True).exists()


def test_a_job_goes_from_accepted_to_complete_and_then_posts_and_unlocks(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    seen = []
    for kind, body in (("accepted", {}), ("started", {"pid": 7}), ("actuated", {"report": {}})):
        edge.report(kind, attempt.id, **body)
        attempt.refresh_from_db()
        seen.append((Job.objects.get(pk=attempt.job_id).state, attempt.transaction.state))
        attempt = Attempt.objects.select_related("transaction", "job").get(pk=attempt.pk)
    assert [job for job, _ in seen] == ["accepted", "running", "completing"]
    assert attempt.worker_pid == 7
    assert attempt.transaction.state == "confirming"
    assert locks_of(attempt) > 0
    edge.finish(attempt)
    attempt = Attempt.objects.select_related("transaction", "job").get(pk=attempt.pk)
    assert (attempt.job.state, attempt.transaction.state) == ("complete", "committed")
    assert locks_of(attempt) == 0
    states = Entry.objects.filter(transaction=attempt.transaction).values_list("state", flat=True)
    assert sorted(states) == ["pending", "posted", "void"]


def test_a_frame_that_comes_twice_changes_nothing_the_second_time(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    edge.complete(attempt)
    events, moved = Event.objects.count(), held_nl(bench, "water")
    assert edge.send(*edge.events) == len(edge.events)
    assert Event.objects.count() == events
    assert held_nl(bench, "water") == moved
    assert HostEvent.objects.count() == len(edge.events)


def test_a_gap_quarantines_the_host_and_keeps_nothing_of_the_frame(bench: Bench) -> None:
    edge = an_edge(bench)
    attempt = dispatched(a_started_run(bench))
    edge.event("accepted", attempt.id)
    late = edge.event("started", attempt.id)
    assert edge.send(late) is None
    assert bench.host.state == "quarantined"
    assert Ticket.objects.get().code == "host.gap"
    assert not HostEvent.objects.exists()
    assert services.dispatch_ready() == 0


def test_a_fork_quarantines_the_host(bench: Bench) -> None:
    edge = an_edge(bench)
    attempt = dispatched(a_started_run(bench))
    event = edge.event("accepted", attempt.id)
    assert edge.send(msgspec.structs.replace(event, body={"changed": True})) is None
    assert Ticket.objects.get().code == "host.fork"
    assert bench.host.state == "quarantined"


def test_an_event_that_skips_a_state_quarantines_the_host_and_settles_nothing(
    bench: Bench,
) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    before = held_nl(bench, "water")
    body = edge.settled(attempt, Outcome(kind=OutcomeKind.DONE))
    assert edge.report("complete", attempt.id, **body) is None
    assert Ticket.objects.get().code == "host.bad_event"
    assert held_nl(bench, "water") == before
    assert locks_of(attempt) > 0


def test_an_event_that_cannot_be_stored_quarantines_the_host(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    assert edge.report("started", attempt.id, pid=2**80) is None
    assert Ticket.objects.get().code == "host.bad_event"
    assert not HostEvent.objects.filter(kind="started", action_id=attempt.id).exists()


def test_events_of_an_older_session_are_not_taken(bench: Bench) -> None:
    edge = an_edge(bench)
    attempt = dispatched(a_started_run(bench))
    old = edge.epoch
    edge.connect()
    event = edge.event("accepted", attempt.id)
    assert host_events.ingest_events(edge.host_id, old, [event]) is None
    assert bench.host.state == "online", "an old session is over, not wrong"
    assert edge.send(event) == 1


def test_a_host_cannot_report_on_the_action_of_another_host(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    other = enrollment_services.add_host(
        bench.lab, key="other", name="Other", host_id=uuid4(), public_key=public_half(edge.key)
    )
    stranger = Edge(bench)
    stranger.host_id = other.id
    stranger.connect()
    stranger.report("accepted", attempt.id)
    assert Job.objects.get(pk=attempt.job_id).state == "dispatched"
    assert Ticket.objects.get().code == "host.unknown_action"


def test_a_broken_host_does_not_flood_the_tickets(bench: Bench) -> None:
    edge = an_edge(bench)
    one = uuid4()
    for kind in ("accepted", "started", "actuated"):
        assert edge.report(kind, one) is not None
    assert Ticket.objects.count() == 1, "one for the action"
    for _ in range(40):
        assert edge.report("accepted", uuid4()) is not None
        body = {"transfer_id": str(uuid4()), "resource_id": str(uuid4())}
        assert edge.report("kept", None, **body) is not None
    tickets = Ticket.objects.values_list("code", flat=True)
    assert sorted(set(tickets)) == ["custody.conflict", "host.unknown_action"]
    assert len(tickets) == 2 * MOST_ALIKE
    assert HostEvent.objects.filter(host=edge.host_id).count() >= 83, "and all stays on record"


def test_an_action_in_doubt_quarantines_its_vessels_and_keeps_its_locks(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    locks = locks_of(attempt)
    edge.lose(attempt)
    attempt = Attempt.objects.select_related("transaction", "job").get(pk=attempt.pk)
    assert (attempt.job.state, attempt.transaction.state) == ("in_doubt", "quarantined")
    closed = Resource.objects.filter(quarantined_by=attempt.transaction_id)
    assert {str(row.id) for row in closed} == {
        attempt.job.operation["source_id"],
        attempt.job.operation["target_id"],
    }
    assert locks_of(attempt) == locks > 0
    assert not Entry.objects.filter(transaction=attempt.transaction, state="posted").exists()
    assert Run.objects.get(pk=run.pk).state == "paused"
    assert services.dispatch_ready() == 0


def test_a_run_that_waits_for_an_answer_is_one_thing_that_needs_a_person(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    edge.lose(to_transfer(run, edge))
    assert lab_summary(bench.lab).counts.needs_you == 1
    a_started_run(bench, HEAT)
    assert lab_summary(bench.lab).counts.needs_you == 2


@pytest.mark.parametrize(
    ("answer", "moved_nl", "job_state", "transaction_state"),
    [
        ("happened", None, "complete", "committed"),
        ("did_not", None, "aborted", "rolled_back"),
        ("partly", 1_250_000, "aborted", "committed"),
    ],
)
def test_a_persons_answer_settles_what_was_in_doubt(
    bench: Bench, answer: str, moved_nl: int | None, job_state: str, transaction_state: str
) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    asked = attempt.job.operation["amount_nl"]
    source = Resource.objects.get(pk=attempt.job.operation["source_id"])
    before = held_nl(bench, source.key)
    edge.lose(attempt)
    chemist = bench.people["chemist"]
    services.resolve_job(
        attempt.job_id, actor=chemist, answer=answer, moved_nl=moved_nl, note="I looked"
    )
    assert Job.objects.get(pk=attempt.job_id).state == "in_doubt", "the host settles, not we"
    edge.resolve(attempt)
    attempt = Attempt.objects.select_related("transaction", "job").get(pk=attempt.pk)
    assert (attempt.job.state, attempt.transaction.state) == (job_state, transaction_state)
    moved = {"happened": asked, "did_not": 0, "partly": moved_nl}[answer]
    assert held_nl(bench, source.key) == before - (moved or 0)
    assert locks_of(attempt) == 0
    assert not Resource.objects.filter(quarantined_by__isnull=False).exists()
    assert not Ticket.objects.exists()


def test_what_a_person_gives_up_stays_quarantined(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    edge.lose(attempt)
    services.resolve_job(
        attempt.job_id, actor=bench.people["chemist"], answer="discard", moved_nl=None, note="lost"
    )
    edge.resolve(attempt)
    attempt = Attempt.objects.select_related("transaction", "job").get(pk=attempt.pk)
    assert (attempt.job.state, attempt.transaction.state) == ("aborted", "rolled_back")
    assert Resource.objects.filter(quarantined_by=attempt.transaction_id).count() == 2
    assert locks_of(attempt) == 0


@pytest.mark.parametrize(
    ("answer", "moved_nl", "note", "code"),
    [
        ("perhaps", None, "I looked", "run.bad_answer"),
        ("partly", None, "I looked", "run.bad_answer"),
        ("partly", 5_000_000_000, "I looked", "run.bad_amount"),
        ("happened", 4_000_000, "I looked", "run.bad_amount"),
        ("happened", None, " ", "run.note_missing"),
    ],
)
def test_an_answer_that_says_too_little_is_refused(
    bench: Bench, answer: str, moved_nl: int | None, note: str, code: str
) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    edge.lose(attempt)
    with pytest.raises(DefinitionError) as refusal:
        services.resolve_job(
            attempt.job_id,
            actor=bench.people["chemist"],
            answer=answer,
            moved_nl=moved_nl,
            note=note,
        )
    assert refusal.value.code == code


def test_a_second_answer_waits_for_the_first(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    edge.lose(attempt)
    answer = partial(
        services.resolve_job,
        attempt.job_id,
        actor=bench.people["chemist"],
        moved_nl=None,
        note="I looked",
    )
    answer(answer="happened")
    with pytest.raises(StateError) as refusal:
        answer(answer="did_not")
    assert refusal.value.code == "run.answered"


def test_a_difference_between_edge_and_server_opens_a_ticket_and_closes_the_vessels(
    bench: Bench,
) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    edge.act(attempt)
    body = edge.settled(attempt, Outcome(kind=OutcomeKind.DONE))
    body["change"]["postings"][0]["amount_nl"] -= 1
    edge.report("complete", attempt.id, **body)
    ticket = Ticket.objects.get()
    assert ticket.code == "reconcile.drift"
    assert ticket.detail["edge"] != ticket.detail["server"]
    assert Resource.objects.filter(quarantined_by=attempt.transaction_id).count() == 2
    assert Job.objects.get(pk=attempt.job_id).state == "complete", "drift never moves a job"


def test_a_refusal_of_the_host_moves_nothing_and_pauses_the_run(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    edge.report("accepted", attempt.id)
    edge.report("rejected", attempt.id, code="edge.expired", message="too late")
    attempt = Attempt.objects.select_related("transaction", "job").get(pk=attempt.pk)
    assert (attempt.job.state, attempt.transaction.state) == ("rejected", "rolled_back")
    assert attempt.job.code == "edge.expired"
    assert locks_of(attempt) == 0
    assert Run.objects.get(pk=run.pk).state == "paused"
