"""Move jobs and runs from state to state; every other module goes through here."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import partial
from typing import Any
from uuid import UUID

from django.db.models import Max
from django.db.transaction import atomic, on_commit

from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import happened_at, now, told
from labweb.common.database.prepared_queries import Question, together, updating
from labweb.common.dispatcher_wakeup import wake_dispatcher
from labweb.domain.errors import LockedError, PreconditionError
from labweb.domain.runs.dispatch.job_scheduler import run_state, state_after_dispatch
from labweb.domain.runs.states.job_states import FINAL, JobState, Mover, RunState, check_step
from labweb.runs import selectors
from labweb.runs.models import Job, Run
from labweb.runs.services.execution import run_holds


def move_job(job: Job, state: JobState, mover: Mover, **fields: Any) -> None:  # noqa: ANN401
    """Take a job to another state.

    Raises:
        StateError: The table of steps does not list it. Nothing was written.
    """
    together(moving(job, state, mover, **fields))
    if mover is not Mover.SCHEDULER and (state is JobState.QUEUED or state in FINAL):
        wake_dispatcher()
    on_commit(partial(announce, job.run_id, job.id))


def moving(job: Job, state: JobState, mover: Mover, **fields: Any) -> Question[Any]:  # noqa: ANN401
    """Return what writes that step alone, to be asked with others; raises as above."""
    check_step(JobState(job.state), state, mover)
    job.state = state.value
    job.state_at = now()
    found, names = told(), ["state", "state_at", "started_at", "ended_at"]
    if state is JobState.RUNNING and job.started_at is None:
        job.started_at = happened_at()
    if state in FINAL:
        job.ended_at = happened_at()
    if found is not None:
        job.uncertainty_s = max(found.uncertainty_s, job.uncertainty_s or 0.0)
        job.is_bounded = job.is_bounded or found.is_bounded
        names += ["uncertainty_s", "is_bounded"]
    for name, value in fields.items():
        setattr(job, name, value)
    return updating(job, *names, *fields)


def announce(run_id: UUID, job_id: UUID | None = None) -> None:
    """Tell browsers that a run changed."""
    data = {"run_id": str(run_id), "job_id": None if job_id is None else str(job_id)}
    feed.publish_all([(f"run:{run_id}", data), ("runs", data)])


def note_sent(run: Run) -> None:
    """Bring a run that is locked in line with a job of it that was sent."""
    noting = noting_sent(run)
    if noting is None:
        refresh_run(run.pk)
    else:
        together(*noting)


def noting_sent(run: Run) -> list[Question[Any]] | None:
    """Return what writes that, to be asked with others; None: all its jobs decide."""
    state = state_after_dispatch(RunState(run.state))
    if state is None:
        return None
    if run.started_at is not None and run.state == state.value:
        return []
    run.started_at = run.started_at or now()
    run.state = state.value
    return [updating(run, "started_at", "state")]


def check_not_halting(jobs: Sequence[Job], halting: Collection[UUID]) -> None:
    """Refuse to send anything to a device before a halt that was asked for is delivered.

    Raises:
        LockedError: One of the devices is among `halting`.
    """
    waiting = next((job for job in jobs if job.device_id in halting), None)
    if waiting is not None:
        raise LockedError(f"{waiting.device.name} is to be halted first", code="run.halt_first")


def add_pause(run: Run, kind: str, actor: User) -> None:
    """Add a reason; each person's own counts, so that nobody's is lost behind another's."""
    alike = [one for one in run.pause_reasons if one["kind"] == kind]
    if selectors.has_paused(alike, actor) or (alike and kind != "user"):
        return
    by = {"by": actor.printed_name, "by_id": str(actor.pk)}
    entry = {"kind": kind, **by, "at": now().isoformat()}
    run.pause_reasons = [*run.pause_reasons, entry]
    run.save(update_fields=["pause_reasons"])


def refresh_run(run_id: UUID) -> Run:
    """Bring a run's state in line with its jobs and its pause reasons."""
    run = selectors.run_for_update(run_id)
    jobs = selectors.views(run_id)
    is_halting = run.is_given_up and selectors.is_halting(run_id)
    state = run_state(RunState(run.state), jobs, is_given_up=run.is_given_up, is_halting=is_halting)
    if run.pause_reasons and state in {RunState.QUEUED, RunState.RUNNING}:
        is_moving = state is RunState.RUNNING and any(
            job.state
            in {JobState.DISPATCHED, JobState.ACCEPTED, JobState.RUNNING, JobState.COMPLETING}
            for job in jobs
        )
        state = RunState.PAUSING if is_moving else RunState.PAUSED
    if state.value != run.state:
        run.state = state.value
        if state in {RunState.COMPLETE, RunState.ABORTED}:
            last = Job.objects.filter(run=run).aggregate(at=Max("ended_at"))["at"]
            run.ended_at = happened_at() if last is None else max(happened_at(), last)
        run.save(update_fields=["state", "ended_at"])
        on_commit(partial(announce, run_id))
    run_holds.release(run)
    return run


def hold_job(job_id: UUID, error: PreconditionError) -> None:
    """Hold a job whose precondition fails now; a person resumes its run when it holds."""
    with atomic():
        selectors.run_for_update(Job.objects.values_list("run_id", flat=True).get(pk=job_id))
        job = selectors.job_for_update(job_id)
        if job.state == JobState.QUEUED.value:
            move_job(job, JobState.HELD, Mover.SERVER, code=error.code, message=error.message)
            refresh_run(job.run_id)
