"""What becomes of the work of a host that cannot be trusted, or is away."""

from __future__ import annotations

from uuid import uuid4

import pytest
from django.core.management import CommandError, call_command

from labweb.crutd.models import ResourceLock, Ticket
from labweb.domain.errors import DefinitionError, StateError
from labweb.enrollment import services as enrollment_services
from labweb.fleet.services import fencing, host_absence
from labweb.resources.models import Resource
from labweb.runs import services
from labweb.runs.models import Attempt, Job, Outbox
from labweb.runs.services.execution.dispatch import send_cancel
from tests.builders import Bench, Edge, a_started_run, an_edge, dispatched, next_job, to_transfer
from tests.labweb.web import signed_in


def state_of(attempt: Attempt) -> str:
    return Job.objects.get(pk=attempt.job_id).state


def quarantined(bench: Bench) -> tuple[Edge, Attempt]:
    """A host whose log has a gap, with a transfer that acts."""
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    edge.begin(attempt)
    edge.event("actuated", attempt.id, report={})
    late = edge.event("complete", attempt.id)
    assert edge.send(late) is None
    return edge, attempt


def readmitted(bench: Bench) -> Edge:
    """The host with a new journal, after a person let it in again."""
    enrollment_services.readmit_host(
        bench.host.id, actor=bench.people["admin"], reason="I looked at every vessel"
    )
    fresh = Edge(bench)
    fresh.connect()
    return fresh


def test_what_a_quarantined_host_was_given_is_in_doubt_and_stays_locked(bench: Bench) -> None:
    _, attempt = quarantined(bench)
    assert state_of(attempt) == "in_doubt"
    assert Resource.objects.filter(quarantined_by=attempt.transaction_id).count() == 2
    assert ResourceLock.objects.filter(released_at__isnull=True).exists()
    assert not Outbox.objects.filter(settled_at__isnull=True).exists()
    assert bench.host.floor == bench.host.last_dseq + 1


def test_a_quarantine_outlives_a_reconnect(bench: Bench) -> None:
    edge, attempt = quarantined(bench)
    welcome = enrollment_services.open_session(edge.hello("n"), "n")
    assert welcome.mode == "quarantine"
    assert welcome.floor > attempt.dseq
    edge.epoch = welcome.epoch
    assert edge.send(*edge.events) is None
    assert state_of(attempt) == "in_doubt"
    fencing.note_quarantine(edge.host_id)
    assert Ticket.objects.count() == 1


def test_a_host_is_let_in_again_only_from_quarantine_and_for_a_reason(bench: Bench) -> None:
    edge = an_edge(bench)
    with pytest.raises(StateError) as refusal:
        readmitted(bench)
    assert refusal.value.code == "host.not_quarantined"
    edge.event("boot", None)
    edge.report("armed", None)
    edge.send(edge.event("boot", None))
    edge.send(edge.event("boot", None, x=1))
    del edge.events[2:]
    assert enrollment_services.open_session(edge.hello("n"), "n").mode == "quarantine"
    with pytest.raises(DefinitionError) as empty:
        enrollment_services.readmit_host(edge.host_id, actor=bench.people["admin"], reason=" ")
    assert empty.value.code == "host.no_reason"


def test_an_answer_waits_until_the_host_has_begun_another_journal(bench: Bench) -> None:
    _, attempt = quarantined(bench)
    chemist = bench.people["chemist"]

    def answer() -> None:
        services.resolve_job(
            attempt.job_id, actor=chemist, answer="happened", moved_nl=None, note="I looked"
        )

    with pytest.raises(StateError) as refusal:
        answer()
    assert refusal.value.code == "run.host_quarantined"
    readmitted(bench)
    answer()
    assert state_of(attempt) == "complete"
    assert not Resource.objects.filter(quarantined_by__isnull=False).exists()
    assert not Outbox.objects.filter(kind="resolve").exists(), "its journal cannot tell"


def test_a_readmitted_host_gets_work_again(bench: Bench) -> None:
    quarantined(bench)
    fresh = readmitted(bench)
    assert bench.host.state == "online"
    assert bench.host.journal_id == fresh.journal_id


def test_a_command_line_readmits_in_the_name_of_a_person(bench: Bench) -> None:
    quarantined(bench)
    with pytest.raises(CommandError, match="no such host or no such user"):
        call_command("readmit_host", bench.host.key, user="nobody", reason="I looked")
    with pytest.raises(CommandError, match="forbidden"):
        call_command("readmit_host", bench.host.key, user="observer", reason="I looked")
    assert bench.host.state == "quarantined"
    call_command("readmit_host", bench.host.key, user="admin", reason="I looked")
    assert bench.host.state == "isolated"


def test_a_cancel_that_overtakes_its_command_quarantines_nobody(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = dispatched(run)
    send_cancel(attempt, issued_by="somebody")
    edge.report("stopped", attempt.id, code="edge.cancelled", is_tombstone=True)
    edge.report("refused", attempt.id, command="do", code="envelope.cancelled")
    assert state_of(attempt) == "stopped"
    assert bench.host.state == "online"
    assert not Outbox.objects.filter(action_id=attempt.id, settled_at__isnull=True).exists()


def test_a_refused_answer_leaves_its_job_in_doubt_and_may_be_given_anew(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    edge.lose(attempt)
    chemist = bench.people["chemist"]
    services.resolve_job(
        attempt.job_id, actor=chemist, answer="happened", moved_nl=None, note="I looked"
    )
    edge.report("refused", attempt.id, command="resolve", code="crutd.contradiction")
    assert state_of(attempt) == "in_doubt"
    assert bench.host.state == "online"
    services.resolve_job(
        attempt.job_id, actor=chemist, answer="did_not", moved_nl=None, note="I looked again"
    )
    edge.resolve(attempt)
    assert state_of(attempt) == "aborted"


def test_what_waits_for_an_isolated_host_is_suspended_and_what_was_sent_is_not(
    bench: Bench,
) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = dispatched(run)
    enrollment_services.watch_hosts({edge.host_id: 30.0})
    assert host_absence.isolate_hosts() > 0
    assert state_of(attempt) == "dispatched"
    waiting = run.jobs.exclude(pk=attempt.job_id)
    assert set(waiting.values_list("state", flat=True)) == {"suspended"}
    told = signed_in(bench.people["chemist"]).get(f"/api/v1/runs/{run.id}").json()["hosts_away"]
    assert [(one["jobs_count"], one["job_ids"]) for one in told] == [(1, [str(attempt.job_id)])]
    assert host_absence.isolate_hosts() == 0
    enrollment_services.beat(edge.host_id, edge.epoch, {})
    host_absence.isolate_hosts()
    assert set(waiting.values_list("state", flat=True)) == {"queued"}
    edge.complete(attempt)
    assert next_job(run).state == "queued"


def test_a_heartbeat_before_the_log_was_read_makes_no_host_online(bench: Bench) -> None:
    edge = an_edge(bench)
    enrollment_services.watch_hosts({edge.host_id: 30.0})
    enrollment_services.beat(edge.host_id, edge.epoch, {}, is_resumed=False)
    assert bench.host.state == "syncing"


def test_a_discarded_action_leaves_the_revisions_that_its_host_has(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    edge.lose(attempt)
    services.resolve_job(
        attempt.job_id, actor=bench.people["chemist"], answer="discard", moved_nl=None, note="lost"
    )
    closed = Resource.objects.filter(quarantined_by=attempt.transaction_id)
    revs = {str(row.id): row.rev + 1 for row in closed}
    body = {"outcome": {"kind": "unknown"}, "change": None, "revs": revs}
    edge.report("resolved", attempt.id, state="aborted", answer="discard", note="", **body)
    assert {str(row.id): row.rev for row in closed.all()} == revs


def test_a_journal_of_the_same_length_with_another_end_is_quarantined(bench: Bench) -> None:
    edge = an_edge(bench)
    edge.report("boot", None)
    edge.events.clear()
    edge.event("boot", None, boot_id=str(uuid4()))
    assert enrollment_services.open_session(edge.hello("n"), "n").mode == "quarantine"
    assert bench.host.heartbeat["code"] == "host.fork"
