"""A batch whose calibration ends while its host works alone: nothing acts with it any more."""

from __future__ import annotations

from datetime import timedelta
from uuid import uuid4

import pytest

from labweb.calibration.models import Calibration
from labweb.calibration.services import calibrations
from labweb.common.clock import now
from labweb.domain.runs.host_actions import host_state
from labweb.domain.runs.host_journal.action_states import ActionState
from labweb.runs import services
from labweb.runs.models import Job, Run
from labweb.workflows.models import WorkflowVersion
from tests.builders import MOVE_WATER, Bench
from tests.labweb.calibration.test_calibrations import accepted
from tests.labweb.runs.hosts import Host, live_locks, states

ALONE = {"on_disconnect": "continue", "max_offline_s": 86_400}
LEFT_S = 100.0


@pytest.fixture
def calibration(bench: Bench) -> Calibration:
    """Return a calibration of pump 1 that ends in less than two minutes."""
    row = accepted(bench)
    row.expires_at = now() + timedelta(seconds=LEFT_S)
    row.save(update_fields=["expires_at"])
    return row


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


@pytest.fixture
def run(bench: Bench, calibration: Calibration, host: Host) -> Run:
    """Return a run that waits to be sent to its host whole, with the calibration in force."""
    assert calibration.expires_at is not None
    assert not host.disk.rows(ActionState.ACCEPTED)
    version = bench.version(MOVE_WATER)
    made = WorkflowVersion.objects.create(
        id=uuid4(),
        workflow=version.workflow,
        number=99,
        document={**version.document, "execution": ALONE},
        author=version.author,
        at=version.at,
        digest=version.digest,
    )
    run = services.start_run(made, actor=bench.people["chemist"])
    assert services.dispatch_ready() == run.jobs.count()
    return run


def lose(host: Host) -> None:
    with host.write() as tx:
        host_state.write_link_lost(tx, host.now())


def first_corrected(run: Run) -> Job:
    return next(job for job in run.jobs.order_by("index") if job.corrections)


def test_a_host_alone_works_on_as_long_as_its_calibration_holds(run: Run, host: Host) -> None:
    host.take()
    lose(host)
    host.mono_s += LEFT_S / 2
    while host.step():
        pass
    host.tell()
    assert set(states(run)) == {"complete"}


def test_a_host_alone_gives_back_what_it_would_do_with_an_expired_calibration(
    run: Run, host: Host, bench: Bench
) -> None:
    host.take()
    lose(host)
    corrected = first_corrected(run)
    for _ in range(corrected.index):
        assert host.step()
    host.mono_s += LEFT_S + 1.0
    while host.step():
        pass
    host.tell()
    found = {job.index: job for job in run.jobs.all()}
    held = found[corrected.index]
    assert (held.state, held.code) == ("held", "calibration.expired")
    assert "calibrate the device" in held.message
    for job in found.values():
        if job.index < corrected.index:
            assert job.state == "complete"
        else:
            assert job.state == "held"
    assert Run.objects.get(pk=run.pk).state == "paused"
    assert live_locks() == 0

    Calibration.objects.update(expires_at=now() - timedelta(seconds=1))
    services.resume_run(run.id, actor=bench.people["chemist"])
    assert services.dispatch_ready() == 0
    codes = {job.code for job in run.jobs.filter(state="held")}
    assert "calibration.expired" in codes


def test_how_long_its_numbers_hold_is_said_when_a_command_is_sent_and_not_when_it_is_written(
    run: Run, host: Host
) -> None:
    host.late_s = LEFT_S + 1.0
    host.take()
    while host.step():
        pass
    host.tell()
    assert (first_corrected(run).state, first_corrected(run).code) == (
        "held", "calibration.expired",
    )  # fmt: skip
    assert not any(job.state == "complete" for job in run.jobs.all() if job.corrections)


DAY_S = 86_400.0


@pytest.mark.parametrize("jump_s", [0.0, DAY_S, -DAY_S])
def test_a_command_that_lay_in_the_broker_while_its_host_was_frozen_counts_that_time(
    run: Run, host: Host, jump_s: float
) -> None:
    host.waited_s = LEFT_S + 1.0
    host.wall_s += jump_s
    host.take()
    while host.step():
        pass
    host.tell()
    held = first_corrected(run)
    assert (held.state, held.code) == ("held", "calibration.expired")
    assert not any(job.state == "complete" for job in run.jobs.all() if job.corrections)


@pytest.mark.parametrize("jump_s", [0.0, DAY_S, -DAY_S])
def test_a_command_that_came_in_time_is_done_whatever_the_wall_clock_says(
    run: Run, host: Host, jump_s: float
) -> None:
    host.waited_s = LEFT_S / 2
    host.wall_s += jump_s
    host.take()
    while host.step():
        pass
    host.tell()
    assert set(states(run)) == {"complete"}


def test_a_clock_that_the_session_did_not_tell_of_decides_nothing(run: Run, host: Host) -> None:
    """The server was restarted: its new clock begins at nought."""
    host.server_clock, host.waited_s = "another-boot", LEFT_S + 1.0
    host.take()
    while host.step():
        pass
    host.tell()
    assert set(states(run)) == {"complete"}


def test_the_way_of_the_answer_counts_as_time_gone_by(host: Host) -> None:
    """Whoever was frozen between the question and the answer takes nothing for younger."""
    asked = host.now()
    tick = host.tick()
    host.mono_s += 60.0
    with host.write() as tx:
        host_state.write_server_clock(tx, tick, asked)
        assert tx.host_state("boot").server_ahead_s == tick.at_s - asked.mono_s
        assert tx.host_state("another boot").server_clock == ""
        host_state.write_server_clock(tx, None, asked)
        assert tx.host_state("boot").server_clock == ""


def test_what_has_not_begun_is_called_back_when_its_calibration_is_withdrawn(
    run: Run, host: Host, bench: Bench, calibration: Calibration
) -> None:
    host.take()
    calibrations.withdraw_calibration(
        calibration.id, actor=bench.people["approver"], reason="the syringe leaks"
    )
    host.take()
    while host.step():
        pass
    host.tell()
    corrected = [job for job in run.jobs.all() if job.corrections]
    assert corrected
    assert {job.state for job in corrected} == {"held"}
    services.resume_run(run.id, actor=bench.people["chemist"])
    services.dispatch_ready()
    assert "calibration.withdrawn" in {job.code for job in run.jobs.filter(state="held")}
