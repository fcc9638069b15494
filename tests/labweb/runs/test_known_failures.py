"""Three failures that laboratories have met before, and clocks that jump."""

from __future__ import annotations

from datetime import timedelta

import pytest

from labweb.common import clock
from labweb.domain.errors import Effect
from labweb.domain.messages.commands import Cancel
from labweb.domain.runs.host_actions import action_execution, command_acceptance, host_state
from labweb.domain.runs.host_actions.action_execution import HostScene, Started
from labweb.domain.runs.host_journal.action_states import ActionReport, ActionState
from labweb.domain.runs.host_journal.host_moment import HostMoment
from labweb.enrollment import services as enrollment_services
from labweb.fleet.services import host_absence
from labweb.runs import services
from labweb.runs.models import Job, Outbox, Run
from tests.builders import Bench, a_started_run
from tests.labweb.runs.hosts import Host, as_sent, live_locks, states

DAY_S = 86_400.0


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


def worked_off(run: Run, host: Host) -> None:
    """Dispatch and carry out until nothing more may go."""
    while services.dispatch_ready():
        host.take()
        while host.step():
            pass
        host.tell()


def test_a_job_that_finishes_while_the_wan_is_down_reports_after_reconnect_and_frees_the_device(
    bench: Bench, host: Host
) -> None:
    run = a_started_run(bench)
    services.dispatch_ready()
    host.take()
    host.tell()
    with host.write() as tx:
        host_state.write_link_lost(tx, host.now())
    assert host.step(), "it acts with the WAN down"
    enrollment_services.watch_hosts({host.edge.host_id: 40.0})
    assert bench.host.state == "isolated"
    host_absence.isolate_hosts()
    assert states(run)[0] == "accepted", "what was dispatched is left alone"
    assert live_locks()
    host.reconnect()
    host.tell()
    assert states(run)[0] == "complete"
    assert not live_locks()
    host_absence.isolate_hosts()
    worked_off(run, host)
    assert Run.objects.get(pk=run.pk).state == "complete"


def test_cancel_of_a_running_job_does_not_harm_the_next(bench: Bench, host: Host) -> None:
    run = a_started_run(bench)
    services.dispatch_ready()
    host.take()
    row = host.disk.rows(ActionState.ACCEPTED)[0]
    with host.write() as tx:
        found = action_execution.start(
            tx, row, row.do, at=host.now(), scene=HostScene(pid=1, driver_digest="d")
        )
    assert isinstance(found, Started)
    host.tell()
    services.abort_run(run.id, actor=bench.people["chemist"], reason="wrong flask")
    cancel = Cancel(
        host_id=host.edge.host_id, epoch=host.edge.epoch, dseq=row.dseq, action_id=row.action_id
    )
    with host.write() as tx:
        command_acceptance.take_command(
            tx, row.signed, cancel, at=host.now(), line_of=lambda device_id: "line"
        )
    halted = ActionReport(ok=False, effect=Effect.NONE, code="device.halted")
    with host.write() as tx:
        action_execution.write_end(tx, row, halted, [])
    host.tell()
    host.take()
    host.halt_owed()
    host.tell()
    assert Run.objects.get(pk=run.pk).state == "aborted"
    following = a_started_run(bench)
    worked_off(following, host)
    assert Run.objects.get(pk=following.pk).state == "complete"


def test_a_failed_send_loses_nothing(bench: Bench, host: Host) -> None:
    run = a_started_run(bench)
    services.dispatch_ready()
    lost = [as_sent(row, host.edge.epoch) for row in Outbox.objects.all()]
    assert lost
    assert services.publish_outbox() == 1, "the broker takes it and loses it"
    assert states(run)[0] == "dispatched"
    past = clock.now() - timedelta(seconds=5)
    Outbox.objects.update(published_at=past)
    assert services.publish_outbox() == 1, "it is rung again until the host has answered"
    for _ in range(3):
        host.take()
    host.tell()
    assert len(host.disk.actions) == 1, "it came three times and was taken once"
    assert services.publish_outbox() == 0
    worked_off(run, host)
    while host.step():
        pass
    host.tell()
    worked_off(run, host)
    assert Run.objects.get(pk=run.pk).state == "complete"


@pytest.mark.parametrize("jump_s", [DAY_S, -DAY_S])
def test_a_wall_clock_of_the_host_that_jumps_changes_no_decision(
    bench: Bench, host: Host, jump_s: float
) -> None:
    run = a_started_run(bench)
    services.dispatch_ready()
    host.take()
    host.wall_s += jump_s
    assert host.step(), "age is counted on the monotonic clock"
    host.tell()
    assert bench.host.state == "online"
    worked_off(run, host)
    assert Run.objects.get(pk=run.pk).state == "complete"


@pytest.mark.parametrize("jump_s", [DAY_S, -DAY_S, 0.0])
def test_after_a_restart_an_action_is_given_back_whatever_the_wall_clock_says(
    bench: Bench, host: Host, jump_s: float
) -> None:
    run = a_started_run(bench)
    services.dispatch_ready()
    host.take()
    row = host.disk.rows(ActionState.ACCEPTED)[0]
    at = HostMoment(boot_id="another boot", mono_s=1.0, wall_s=host.wall_s + jump_s)
    with host.write() as tx:
        host_state.write_armed(tx, at.boot_id, None)
    with host.write() as tx:
        action_execution.start(tx, row, row.do, at=at, scene=HostScene(pid=1, driver_digest="d"))
    host.tell()
    job = Job.objects.get(run=run, index=0)
    assert (job.state, job.code) == ("held", "edge.rebooted")
    assert not live_locks()


@pytest.mark.parametrize("jump_s", [DAY_S, -DAY_S])
def test_a_wall_clock_of_the_server_that_jumps_isolates_nobody(
    bench: Bench, host: Host, jump_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = clock.now
    beat = {"epoch": host.edge.epoch, "mono_s": 1.0, "seq_head": 1, "wall_s": 1.0}
    assert enrollment_services.beat(host.edge.host_id, host.edge.epoch, beat)
    for module in ("labweb.enrollment.services.hosts", "labweb.runs.services.execution.dispatch"):
        monkeypatch.setattr(f"{module}.now", lambda: real() + timedelta(seconds=jump_s))
    enrollment_services.watch_hosts({host.edge.host_id: 1.0})
    assert bench.host.state == "online"
    run = a_started_run(bench)
    worked_off(run, host)
    assert Run.objects.get(pk=run.pk).state == "complete"
