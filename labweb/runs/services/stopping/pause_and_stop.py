"""What people do to runs: pause, resume, abort, resolve, stop the lab."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from uuid import UUID

import msgspec
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import new_id
from labweb.common.dispatcher_wakeup import wake_dispatcher
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd import operations
from labweb.domain.errors import DefinitionError, RevisionError, StateError
from labweb.domain.runs.after_failure.plan_departures import Departure
from labweb.domain.runs.states.job_states import FINAL, UNSTARTED, JobState, Mover, RunState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.resources import selectors as resource_selectors
from labweb.resources import services as resource_services
from labweb.resources.selectors import Lab
from labweb.runs import selectors
from labweb.runs.models import Job, Run
from labweb.runs.services.execution import dispatch
from labweb.runs.services.execution.host_batches import recall_run
from labweb.runs.services.execution.job_states import add_pause, announce, move_job, refresh_run
from labweb.runs.services.planning.lab_view import lab_view
from labweb.runs.services.planning.proof_departures import check_departures, check_proved
from labweb.runs.services.stopping.device_halts import check_halted

_ENDED = {RunState.COMPLETE.value, RunState.ABORTED.value}
_UNDONE = [state.value for state in FINAL - {JobState.COMPLETE}]


def _require(run: Run, actor: User, permission: Permission) -> None:
    ids = {UUID(node) for job in run.jobs.all() for node in job.locks}
    resource_selectors.require(actor, permission, ids)


def _check_not_over(run: Run) -> None:
    if run.state in _ENDED:
        raise StateError(f"run #{run.number} is {run.state}", code="run.ended")
    if run.is_given_up:
        text = (
            f"run #{run.number} was aborted: it ends once each of its devices stands or is known "
            "not to answer"
        )
        raise StateError(text, code="run.aborting")


@atomic
def pause_run(run_id: UUID, *, actor: User, reason: str = "user") -> Run:
    """Hold every job that was not dispatched; what runs goes on to its end.

    Of a batch the hosts are asked to give back what they have not begun.

    Raises:
        StateError: The run has ended.
        ForbiddenError: The actor may not run things here.
    """
    run = selectors.run_for_update(run_id)
    _require(run, actor, Permission.RUN)
    _check_not_over(run)
    add_pause(run, reason, actor)
    recall_run(run, issued_by=str(actor.pk))
    account_services.write_audit("run.pause", str(run.id), actor=actor, reason=reason)
    return refresh_run(run_id)


@atomic
def resume_run(
    run_id: UUID,
    *,
    actor: User,
    departures: Sequence[Departure] | None = None,
    pauses: Sequence[str] | None = None,
) -> Run:
    """Take every pause away and queue what was held: a person says that it may go on.

    Args:
        run_id: Which.
        actor: Who.
        departures: How the run leaves what was proved, as they have seen it: it goes on
            without a proof. None: it goes on only while it leaves nothing.
        pauses: When each pause that they have seen began. None: they answer for all.

    Raises:
        StateError: The run has ended, the lab is stopped, a job is in doubt, a job ended
            undone, which nothing carries out again, or a halt has taken away what a completed
            one had set. Nothing was written.
        PreconditionError: A vessel that the run has not begun with holds what nobody proved the
            recipe with, or the run does something else than was proved and nobody has said
            that it goes on so. Nothing was written.
        RevisionError: It leaves what was proved in another way than was seen, or somebody has
            paused it since.
    """
    run = selectors.run_for_update(run_id)
    _require(run, actor, Permission.RUN)
    _check_not_over(run)
    if run.lab.is_stopped:
        raise StateError("the lab is stopped: reset it first", code="run.lab_stopped")
    if run.jobs.filter(state=JobState.IN_DOUBT.value).exists():
        raise StateError("say first what happened in the job in doubt", code="run.in_doubt")
    undone = run.jobs.filter(state__in=_UNDONE, passed_by="").first()
    if undone is not None:
        raise StateError(
            f"run #{run.number} cannot go on: {undone.sentence!r} ended {undone.state}. Say first "
            "what becomes of it: try it anew, skip it, mark it as done by hand, or abort the run",
            code="run.cannot_go_on",
            context={"job_id": str(undone.id), "state": undone.state},
        )
    check_halted(run)
    _check_pauses_seen(run, pauses)
    check_departures(run, actor=actor, seen=departures)
    _check_untouched(run)
    run.pause_reasons = []
    run.save(update_fields=["pause_reasons"])
    for job in Job.objects.filter(run=run, state=JobState.HELD.value):
        move_job(job, JobState.QUEUED, Mover.SERVER, code="", message="")
    detail = {} if departures is None else {"departures": msgspec.to_builtins(departures)}
    account_services.write_audit("run.resume", str(run.id), actor=actor, detail=detail)
    wake_dispatcher()
    run = refresh_run(run_id)
    on_commit(partial(announce, run_id))
    return run


def _check_pauses_seen(run: Run, seen: Sequence[str] | None) -> None:
    since = [] if seen is None else [one for one in run.pause_reasons if one["at"] not in seen]
    if since:
        who = since[-1]["by"] or "the server"
        raise RevisionError(
            f"run #{run.number} was not resumed: {who} has paused it since you looked",
            code="run.paused_since",
            context={"pauses": [one["at"] for one in since]},
        )


def _check_untouched(run: Run) -> None:
    """Check the vessels that are still to come, and of which no job was sent or done."""
    if run.version.proved is None:
        return
    touched: set[UUID] = set()
    to_come: set[UUID] = set()
    for job in run.jobs.prefetch_related("attempts"):
        ids = operations.touched_ids(operations.from_json(job.operation))
        if job.attempts.all() or job.state == JobState.COMPLETE.value:
            touched.update(ids)
        elif JobState(job.state) in UNSTARTED:
            to_come.update(ids)
    check_proved(run.version, lab_view(run.lab), to_come - touched)


@atomic
def stop_lab(*, actor: User) -> Lab:
    """Latch a software stop: every host halts its devices now and starts nothing more.

    Effect:
        Devices that act are halted; what they had moved is recorded, or goes in doubt.
        It is no emergency stop.
    """
    lab = resource_selectors.lab_for_update(resource_selectors.the_lab().pk)
    root = resource_selectors.root_of(lab)
    resource_selectors.require(actor, Permission.STOP, [root.id])
    stop_id = new_id()
    resource_services.latch_stop(lab, stop_id=stop_id, user_id=actor.pk)
    states = [*selectors.LIVE, RunState.AWAITING_APPROVAL.value]
    runs = Run.objects.filter(lab=lab, state__in=states).order_by("pk")
    for run in runs.select_for_update(of=("self",), no_key=True):
        add_pause(run, "stopped", actor)
        recall_run(run, issued_by=str(actor.pk), is_whole=True)
        refresh_run(run.id)
    dispatch.void_resets(lab)  # after the runs: what a host tells locks its run, then commands
    account_services.write_audit("lab.stop", str(lab.id), actor=actor)
    on_commit(partial(tell_stop, lab.id, stop_id, str(actor.pk)))
    on_commit(partial(feed.publish, "lab", {"is_stopped": True}))
    return lab


def tell_stop(lab_id: UUID, stop_id: UUID, issued_by: str) -> None:
    """Send the stop to every host that has not acknowledged it."""
    lab = resource_selectors.labs().get(pk=lab_id)
    for host in enrollment_selectors.hosts_of(lab).exclude(stop_acknowledged=stop_id):
        message = {"type": "edge.stop", "stop_id": str(stop_id), "issued_by": issued_by}
        enrollment_services.tell_host(host.id, message)


@atomic
def reset_lab(*, actor: User, reason: str) -> Lab:
    """Release the stop latch. Starts nothing: each run is resumed by a person.

    Raises:
        DefinitionError: No reason was given.
        StateError: The lab is not stopped.
        ForbiddenError: The actor may not reset.
    """
    lab = resource_selectors.lab_for_update(resource_selectors.the_lab().pk)
    resource_selectors.require(actor, Permission.RESET, [resource_selectors.root_of(lab).id])
    if not reason.strip():
        raise DefinitionError("say why it is safe to go on", code="lab.reason_missing")
    if not lab.is_stopped or lab.stop_id is None:
        raise StateError("the lab is not stopped", code="lab.not_stopped")
    resource_services.release_stop(lab)
    for host in enrollment_selectors.hosts_of(lab):
        dispatch.send_reset(host, stop_id=lab.stop_id, reason=reason, issued_by=str(actor.pk))
    account_services.write_audit("lab.reset", str(lab.id), actor=actor, reason=reason)
    on_commit(partial(feed.publish, "lab", {"is_stopped": False}))
    return lab
