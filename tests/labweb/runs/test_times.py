"""What a host tells late is in the record when it happened, and when it was heard of."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from uuid import UUID

import msgspec
import pytest
from django.db import connection

from labweb.common.clock import now
from labweb.crutd.models import Entry, Event
from labweb.crutd.selectors.event_chain import first_broken_event
from labweb.crutd.selectors.history_replay import as_it_was
from labweb.crutd.selectors.ledger_verification import ledger_violations
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.records.selectors.conditions import made_s
from labweb.resources.selectors import Resource
from labweb.runs.models import Attempt, HostEvent, Job, Run
from tests.builders import Bench, Edge, a_started_run, an_edge, to_transfer
from tests.labweb.crutd.test_rebuild import move

pytestmark = pytest.mark.django_db

SURE_S = 0.25
_ONE = timedelta(microseconds=1)


def told_late(edge: Edge, attempt: Attempt, began: datetime, ended: datetime) -> None:
    """Have a host tell an action only now that began and ended at these times."""
    first = len(edge.events)
    edge.event("accepted", attempt.id)
    edge.event("started", attempt.id, pid=1)
    edge.event("actuated", attempt.id, report={"ok": True})
    settled = edge.settled(attempt, Outcome(kind=OutcomeKind.DONE))
    edge.event("complete", attempt.id, **settled)
    times = [began, began, ended, ended]
    frame = [
        msgspec.structs.replace(event, happened_s=at.timestamp(), uncertainty_s=SURE_S)
        for event, at in zip(edge.events[first:], times, strict=True)
    ]
    assert edge.send(*frame) == len(edge.events)


def held_then(bench: Bench, vessel: UUID, at: datetime) -> int:
    past = as_it_was(bench.lab, at, now=now())
    return sum(amount.nl for amount in past.contents.get(vessel, {}).values())


def parent_then(bench: Bench, key: str, at: datetime) -> UUID | None:
    past = as_it_was(bench.lab, at, now=now())
    return next(row.parent_id for row in past.rows if row.key == key)


@pytest.fixture
def edge(bench: Bench) -> Edge:
    return an_edge(bench)


def test_an_action_that_is_told_late_stands_when_it_happened(bench: Bench, edge: Edge) -> None:
    """A person carried a flask after it and before the server heard of it."""
    attempt = to_transfer(a_started_run(bench), edge)
    began = now()
    ended = now()
    place = Resource.objects.get(lab=bench.lab, key="flask_2").parent_id
    move(bench, "flask_2", "lab")
    heard = now()
    told_late(edge, attempt, began, ended)

    job = Job.objects.get(pk=attempt.job_id)
    assert (job.started_at, job.ended_at) == (began, ended)
    assert job.state_at >= heard
    assert job.uncertainty_s is not None
    assert job.uncertainty_s <= 2 * SURE_S
    assert not job.is_bounded
    poured, carried = Event.objects.order_by("-seq")[:2]
    assert (poured.transaction_id, poured.at) == (attempt.transaction_id, ended)
    assert poured.received_at is not None
    assert poured.received_at >= heard > carried.at > poured.at
    assert carried.received_at is None
    attempt.transaction.refresh_from_db()
    assert attempt.transaction.settled_at == ended
    entries = Entry.objects.filter(transaction_id=attempt.transaction_id)
    assert {entry.at for entry in entries.exclude(state="pending")} == {ended}
    told = HostEvent.objects.filter(action_id=attempt.id).order_by("id")
    assert [one.happened_at for one in told] == [began, began, ended, ended]
    assert all(one.received_at >= heard for one in told)

    target = UUID(attempt.job.operation["target_id"])
    before, after = (held_then(bench, target, at) for at in (began - _ONE, ended))
    assert after > before
    assert parent_then(bench, "flask_2", ended) == place
    assert parent_then(bench, "flask_2", heard) != place
    assert first_broken_event(bench.lab) is None
    assert ledger_violations(bench.lab) == []


def test_a_run_ends_with_the_last_of_its_actions(bench: Bench, edge: Edge) -> None:
    run = a_started_run(bench)
    edge.work_off(run)
    run = Run.objects.get(pk=run.pk)
    assert run.state == "complete"
    assert run.ended_at == max(job.ended_at for job in run.jobs.all() if job.ended_at)


def test_a_clock_that_tells_less_than_its_cause_is_bounded_and_says_so(
    bench: Bench, edge: Edge
) -> None:
    attempt = to_transfer(a_started_run(bench), edge)
    yesterday = now() - timedelta(days=1)
    told_late(edge, attempt, yesterday, yesterday)
    job = Job.objects.get(pk=attempt.job_id)
    assert job.started_at == job.ended_at == attempt.at
    assert job.is_bounded
    told = HostEvent.objects.filter(action_id=attempt.id).order_by("id")
    for event in told:
        assert event.happened_at is not None
        assert event.uncertainty_s is not None
        assert event.happened_at + timedelta(seconds=event.uncertainty_s) >= event.received_at - (
            timedelta(seconds=0.1)
        )


def test_a_clock_that_tells_of_tomorrow_is_bounded_by_reception(bench: Bench, edge: Edge) -> None:
    attempt = to_transfer(a_started_run(bench), edge)
    tomorrow = now() + timedelta(days=1)
    told_late(edge, attempt, tomorrow, tomorrow)
    job = Job.objects.get(pk=attempt.job_id)
    assert job.ended_at is not None
    assert attempt.at <= job.ended_at <= now()
    assert job.is_bounded


def test_a_host_that_measures_nothing_is_believed_between_the_bounds(
    bench: Bench, edge: Edge
) -> None:
    attempt = to_transfer(a_started_run(bench), edge)
    bare = edge.event("accepted", attempt.id)
    edge.send(msgspec.structs.replace(bare, happened_s=None, uncertainty_s=None))
    told = HostEvent.objects.get(action_id=attempt.id)
    assert told.is_bounded
    assert told.happened_at == attempt.at


def test_what_was_made_in_the_lab_has_conditions_since_then(bench: Bench) -> None:
    first = Event.objects.order_by("seq")[0]
    flask = Resource.objects.get(lab=bench.lab, key="flask_2")
    assert datetime.fromtimestamp(made_s(flask), UTC) == first.at


def test_what_stands_beside_the_time_of_an_event_is_bound_by_its_hash(
    bench: Bench, edge: Edge
) -> None:
    attempt = to_transfer(a_started_run(bench), edge)
    told_late(edge, attempt, now(), now())
    event = Event.objects.order_by("-seq")[0]
    assert event.received_at is not None
    assert event.body["told"]["received_at"] == event.received_at.isoformat()
    with connection.cursor() as cursor:
        cursor.execute("SET session_replication_role = replica")
        cursor.execute("UPDATE crutd_event SET uncertainty_s = 9 WHERE id = %s", [event.pk])
        cursor.execute("SET session_replication_role = origin")
    found = first_broken_event(bench.lab)
    assert found is not None
    assert found.code == "events.columns"
