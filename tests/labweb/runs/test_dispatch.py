"""From a queued job to a signed command: locks, order, the stop latch."""

from __future__ import annotations

from uuid import UUID

import pytest

from labweb.crutd.models import Entry, ResourceLock
from labweb.domain.errors import (
    DefinitionError,
    ForbiddenError,
    PreconditionError,
    RevisionError,
    StateError,
)
from labweb.runs import services
from labweb.runs.models import Outbox, Run
from tests.builders import Bench, a_started_run, an_edge, dispatched, to_transfer


def live_locks() -> set[tuple[UUID, str]]:
    rows = ResourceLock.objects.filter(released_at__isnull=True)
    return set(rows.values_list("resource_id", "mode"))


def test_a_dispatch_takes_everything_the_job_uses_and_intends_all_above_it(bench: Bench) -> None:
    run = a_started_run(bench)
    an_edge(bench)
    attempt = dispatched(run)
    exclusive = {(UUID(node), "X") for node in attempt.job.locks}
    assert exclusive
    assert {bench.node("lab").id, bench.node("bench_1").id} <= {
        node for node, mode in live_locks() if mode == "IX"
    }
    assert {lock for lock in live_locks() if lock[1] == "X"} == exclusive


def test_a_liquid_transfer_waits_as_a_pending_entry_until_it_is_settled(bench: Bench) -> None:
    run = a_started_run(bench)
    attempt = to_transfer(run, an_edge(bench))
    pending = Entry.objects.get(transaction=attempt.transaction)
    assert pending.state == "pending"
    assert pending.amount_nl == attempt.job.operation["amount_nl"]


def test_nothing_is_dispatched_to_a_host_that_is_not_online(bench: Bench) -> None:
    run = a_started_run(bench)
    assert services.dispatch_ready() == 0
    assert set(run.jobs.values_list("state", flat=True)) == {"queued"}


def test_a_second_run_waits_for_the_locks_of_the_first(bench: Bench) -> None:
    first = a_started_run(bench)
    second = a_started_run(bench)
    edge = an_edge(bench)
    attempt = dispatched(first)
    assert second.jobs.exclude(state="queued").count() == 0
    before = live_locks()
    assert services.dispatch_ready() == 0
    assert live_locks() == before
    edge.complete(attempt)
    assert services.dispatch_ready() == 1


def test_the_command_in_the_outbox_is_signed_for_the_present_epoch(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = dispatched(run)
    assert services.publish_outbox() == 1
    row = Outbox.objects.get(action_id=attempt.id)
    assert row.publish_count == 1
    assert row.body["dseq"] == attempt.dseq == 1
    assert services.publish_outbox() == 0, "it is not rung again at once"
    edge.report("accepted", attempt.id)
    row.refresh_from_db()
    assert row.settled_at is not None


def test_a_stopped_lab_dispatches_nothing_and_starts_nothing(bench: Bench) -> None:
    run = a_started_run(bench)
    an_edge(bench)
    services.stop_lab(actor=bench.people["observer"])
    assert services.dispatch_ready() == 0
    assert Run.objects.get(pk=run.pk).state == "paused"
    with pytest.raises(PreconditionError) as refusal:
        a_started_run(bench)
    assert refusal.value.code == "run.lab_stopped"


@pytest.mark.parametrize("reason", ["", "   "])
def test_a_reset_needs_a_reason(bench: Bench, reason: str) -> None:
    services.stop_lab(actor=bench.people["chemist"])
    with pytest.raises(DefinitionError) as refusal:
        services.reset_lab(actor=bench.people["approver"], reason=reason)
    assert refusal.value.code == "lab.reason_missing"
    bench.lab.refresh_from_db()
    assert bench.lab.is_stopped


def test_a_chemist_may_stop_but_not_reset(bench: Bench) -> None:
    services.stop_lab(actor=bench.people["chemist"])
    with pytest.raises(ForbiddenError):
        services.reset_lab(actor=bench.people["chemist"], reason="all clear")


def test_a_reset_starts_nothing_until_a_person_resumes_the_run(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    services.stop_lab(actor=bench.people["chemist"])
    services.reset_lab(actor=bench.people["approver"], reason="looked at every device")
    assert Outbox.objects.get(kind="reset").settled_at is None
    reset = Outbox.objects.get(kind="reset")
    edge.report("stop_reset", None, stop_id=str(bench.lab.id))
    assert Outbox.objects.get(kind="reset").settled_at is None, "an answer to another reset"
    edge.report("stop_reset", None, stop_id=reset.body["stop_id"])
    assert Outbox.objects.get(kind="reset").settled_at is not None
    assert services.dispatch_ready() == 0
    services.resume_run(run.id, actor=bench.people["chemist"])
    assert services.dispatch_ready() == 1


def test_a_lab_that_is_not_stopped_cannot_be_reset(bench: Bench) -> None:
    with pytest.raises(StateError) as refusal:
        services.reset_lab(actor=bench.people["approver"], reason="nothing to do")
    assert refusal.value.code == "lab.not_stopped"


def test_a_paused_run_lets_what_acts_finish_and_sends_no_more(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = dispatched(run)
    services.pause_run(run.id, actor=bench.people["chemist"])
    assert Run.objects.get(pk=run.pk).state == "pausing"
    edge.complete(attempt)
    assert Run.objects.get(pk=run.pk).state == "paused"
    assert services.dispatch_ready() == 0


def test_two_people_who_pause_a_run_both_stand_among_its_reasons(bench: Bench) -> None:
    run = a_started_run(bench)
    for name in ("chemist", "approver", "chemist"):
        services.pause_run(run.id, actor=bench.people[name])
    reasons = Run.objects.get(pk=run.pk).pause_reasons
    people = [bench.people[name].printed_name for name in ("chemist", "approver")]
    assert [one["by"] for one in reasons] == people
    services.stop_lab(actor=bench.people["chemist"])
    services.stop_lab(actor=bench.people["approver"])
    kinds = [one["kind"] for one in Run.objects.get(pk=run.pk).pause_reasons]
    assert kinds == ["user", "user", "stopped"]


def test_a_run_that_somebody_paused_since_it_was_seen_is_not_resumed(bench: Bench) -> None:
    run = a_started_run(bench)
    chemist, approver = bench.people["chemist"], bench.people["approver"]
    seen = [one["at"] for one in services.pause_run(run.id, actor=chemist).pause_reasons]
    services.pause_run(run.id, actor=approver)
    with pytest.raises(RevisionError) as refusal:
        services.resume_run(run.id, actor=chemist, pauses=seen)
    assert refusal.value.code == "run.paused_since"
    assert approver.printed_name in refusal.value.message
    reasons = Run.objects.get(pk=run.pk).pause_reasons
    assert len(reasons) == 2
    services.resume_run(run.id, actor=chemist, pauses=[one["at"] for one in reasons])
    assert Run.objects.get(pk=run.pk).pause_reasons == []


def test_an_aborted_run_stops_what_has_not_begun_and_cancels_what_was_sent(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = dispatched(run)
    services.abort_run(run.id, actor=bench.people["chemist"], reason="wrong flask")
    assert Outbox.objects.get(kind="cancel").action_id == attempt.id
    assert set(run.jobs.exclude(pk=attempt.job_id).values_list("state", flat=True)) == {"stopped"}
    edge.report("stopped", attempt.id)
    assert Run.objects.get(pk=run.pk).state == "aborted"
    assert live_locks() == set()
