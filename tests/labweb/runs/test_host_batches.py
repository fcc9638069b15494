"""Runs that declare `execution`: their hosts get their part whole, and go on by themselves."""

from __future__ import annotations

from uuid import uuid4

import pytest

from labweb.crutd.models import ResourceLock
from labweb.domain.errors import StateError
from labweb.domain.runs.host_actions import host_state
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.enrollment import services as enrollment_services
from labweb.fleet.services import fencing
from labweb.resources.models import Resource
from labweb.runs import services
from labweb.runs.models import Attempt, Job, Outbox, Run
from labweb.workflows.models import WorkflowVersion
from tests.builders import MOVE_WATER, Bench, a_user
from tests.labweb.runs.hosts import Host, live_locks, states

ALONE = {"on_disconnect": "continue", "max_offline_s": 600}


@pytest.fixture
def run(bench: Bench) -> Run:
    version = bench.version(MOVE_WATER)
    document = {**version.document, "execution": ALONE}
    made = WorkflowVersion.objects.create(
        id=uuid4(),
        workflow=version.workflow,
        number=99,
        document=document,
        author=version.author,
        at=version.at,
        digest=version.digest,
    )
    return services.start_run(made, actor=bench.people["chemist"])


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


def test_a_run_that_declares_execution_goes_to_its_host_whole(run: Run, host: Host) -> None:
    count = run.jobs.count()
    assert count > 2
    assert services.dispatch_ready() == count
    assert set(states(run)) == {"dispatched"}
    assert Outbox.objects.get().kind == "batch"
    assert Attempt.objects.values("batch_id").distinct().count() == 1


def test_a_batch_ends_with_no_further_word_from_the_server(run: Run, host: Host) -> None:
    services.dispatch_ready()
    host.take()
    with host.write() as tx:
        host_state.write_link_lost(tx, host.now())
    while host.step():
        host.mono_s += 1.0
    assert set(states(run)) == {"dispatched"}, "the server has heard nothing yet"
    host.tell()
    assert set(states(run)) == {"complete"}
    assert Run.objects.get(pk=run.pk).state == "complete"
    assert live_locks() == 0
    assert not Outbox.objects.filter(settled_at__isnull=True).exists()


def test_a_batch_holds_when_the_server_is_away_for_too_long(run: Run, host: Host) -> None:
    services.dispatch_ready()
    host.take()
    with host.write() as tx:
        host_state.write_link_lost(tx, host.now())
    assert host.step()
    host.mono_s += 601.0
    assert not host.step()
    with host.write() as tx:
        host_state.write_armed(tx, "boot", None)
    assert host.step()


def test_what_a_later_member_needs_is_never_free_in_between(run: Run, host: Host) -> None:
    services.dispatch_ready()
    before = live_locks()
    host.take()
    host.step()
    host.tell()
    assert "complete" in states(run)
    assert 0 < live_locks() <= before
    open_jobs = Job.objects.filter(run=run).exclude(state="complete")
    needed = {node for job in open_jobs for node in job.locks}
    held = ResourceLock.objects.filter(released_at__isnull=True, mode="X")
    assert needed == {str(node) for node in held.values_list("resource_id", flat=True)}


def test_a_pause_gets_back_what_has_not_begun_and_a_resume_sends_it_again(
    run: Run, host: Host, bench: Bench
) -> None:
    services.dispatch_ready()
    host.take()
    host.step()
    host.tell()
    services.pause_run(run.id, actor=bench.people["chemist"])
    host.take()
    host.tell()
    assert set(states(run)) == {"complete", "held"}
    assert Run.objects.get(pk=run.pk).state == "paused"
    assert live_locks() == 0
    services.resume_run(run.id, actor=bench.people["chemist"])
    assert services.dispatch_ready() == run.jobs.count() - 1
    host.take()
    while host.step():
        pass
    host.tell()
    assert set(states(run)) == {"complete"}
    assert max(run.jobs.values_list("attempts__number", flat=True)) == 2


def test_a_failed_member_gives_the_rest_back_and_a_retry_goes_on(
    run: Run, host: Host, bench: Bench
) -> None:
    services.dispatch_ready()
    host.take()
    host.step(report=ActionReport(ok=False, code="device.stuck", message="it is stuck"))
    while host.step():
        pass
    host.tell()
    assert states(run)[0] == "aborted"
    assert set(states(run)[1:]) == {"held"}
    first = Job.objects.get(run=run, index=0)
    services.recover_job(
        first.id, actor=bench.people["chemist"], choice="retry", note="I freed the plunger"
    )
    services.resume_run(run.id, actor=bench.people["chemist"])
    services.dispatch_ready()
    host.take()
    while host.step():
        pass
    host.tell()
    assert Run.objects.get(pk=run.pk).state == "complete"
    assert [entry["choice"] for entry in Run.objects.get(pk=run.pk).recoveries] == ["retry"]


def test_an_answer_that_the_record_contradicts_is_refused_and_the_doubt_stays(
    run: Run, host: Host, bench: Bench
) -> None:
    services.dispatch_ready()
    host.take()
    host.tell()
    bench.host.__class__.objects.filter(pk=bench.host.pk).update(state="isolated")
    admin = bench.people["admin"]
    fencing.fence_host(bench.host.id, actor=admin, reason="the machine burnt")
    other = a_user("admin", on=bench.node("lab"), name="other")
    fencing.fence_host(bench.host.id, actor=other, reason="I saw it too")

    def answer(job: Job, told: str) -> None:
        services.resolve_job(job.id, actor=admin, answer=told, moved_nl=None, note="I looked")

    drawn, given = [job for job in run.jobs.order_by("index") if "amount_nl" in job.operation][:2]
    answer(drawn, "did_not")
    with pytest.raises(StateError) as refusal:
        answer(given, "happened")
    assert refusal.value.code == "crutd.contradiction"
    assert ", which held 0.00 mL. Answer that nobody can tell" in refusal.value.message
    assert Job.objects.get(pk=given.pk).state == "in_doubt"
    answer(given, "discard")
    assert Job.objects.get(pk=given.pk).state == "aborted"
    assert Resource.objects.get(pk=given.operation["target_id"]).quarantined_by is not None


def test_a_fence_of_two_puts_every_member_in_doubt_and_people_answer_for_them(
    run: Run, host: Host, bench: Bench
) -> None:
    services.dispatch_ready()
    host.take()
    host.tell()
    bench.host.__class__.objects.filter(pk=bench.host.pk).update(state="isolated")
    admin = bench.people["admin"]
    fencing.fence_host(bench.host.id, actor=admin, reason="the machine burnt")
    assert set(states(run)) == {"accepted"}
    other = a_user("admin", on=bench.node("lab"), name="other")
    fencing.fence_host(bench.host.id, actor=other, reason="I saw it too")
    assert set(states(run)) == {"in_doubt"}
    for job in run.jobs.order_by("index"):
        services.resolve_job(
            job.id, actor=admin, answer="did_not", moved_nl=None, note="the machine was dead"
        )
    assert set(states(run)) == {"aborted"}
    assert live_locks() == 0
    assert enrollment_services.open_session(host.edge.hello("n"), "n").mode == "quarantine"
