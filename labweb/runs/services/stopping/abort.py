"""Abort a run, stop one device: halt what acts, then all that still goes on because of it."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import timedelta
from functools import partial
from uuid import UUID

from django.db.models import Max, Min, Q
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.approvals import services as approval_services
from labweb.common import feed
from labweb.common.clock import new_id, now
from labweb.common.dispatcher_wakeup import wake_dispatcher
from labweb.common.render import iso
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import DefinitionError, StateError
from labweb.domain.messages.commands import Halt
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.halts.halt_progress import (
    OPEN_HALTS,
    UNDECIDED,
    HaltState,
    Set,
    halt_wish,
    is_off_since,
    who_keeps,
)
from labweb.domain.runs.halts.halted_setpoints import (
    DEVICE_STOPPED,
    RUN_ABORTED,
    Done,
    leaves_standing,
    may_stand,
    still_standing,
)
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import AT_EDGE, UNSTARTED, JobState, Mover, RunState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device, EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors
from labweb.runs.models import Attempt, DeviceHalt, Job, Outbox, Run
from labweb.runs.services.execution import dispatch
from labweb.runs.services.execution.host_batches import recall_run
from labweb.runs.services.execution.job_states import add_pause, announce, move_job, refresh_run
from labweb.runs.services.job_confirmation import tell_unbooked

_ENDED = {RunState.COMPLETE.value, RunState.ABORTED.value}
_ACTING = {JobState.RUNNING.value, JobState.COMPLETING.value, JobState.IN_DOUBT.value}
_AT_EDGE = [state.value for state in AT_EDGE]
_OPEN = [state.value for state in OPEN_HALTS]
_LISTENING = {SessionState.ONLINE.value, SessionState.SUSPECT.value, SessionState.SYNCING.value}
_GIVEN_UP = {SessionState.FENCED.value, SessionState.REVOKED.value}

SILENT_AFTER_S = 15.0
"""A host that has not told by then what came of a halt owes it, as far as anybody knows."""

AWAY = "its host is away; it is halted when the host is back"
NO_WORD = "its host has not said yet that it was halted"
LOST = "its host was given up: look at the device yourself"


# --- what people ask for ------------------------------------------------------------


@atomic
def abort_run(run_id: UUID, *, actor: User, reason: str) -> Run:
    """Halt what acts of a run, then every device that it has set and that still goes on.

    What has not begun never begins. The run ends once nothing of it acts, and it is known of each
    device whether it stands, or why it cannot be halted yet. Asked for again it changes nothing;
    what got lost on its way is sent again.

    Raises:
        DefinitionError: No reason was given.
        StateError: The run has ended.
        ForbiddenError: The actor may not run things here.

    Effect:
        Devices that act for it are halted within seconds, as are heaters, stirrers, pumps and
        supplies that it has set, unless another live run works with them. How far each action
        came is recorded. Nothing is undone; liquid in a syringe stays there.
    """
    run = _held(run_id)
    ids = {UUID(node) for job in run.jobs.all() for node in job.locks}
    resource_selectors.require(actor, Permission.RUN, ids)
    if not reason.strip():
        raise DefinitionError("say why the run is given up", code="run.reason_missing")
    if run.state in _ENDED:
        raise StateError(f"run #{run.number} is {run.state} already", code="run.ended")
    if not run.is_given_up:
        approval_services.withdraw(run.id)
        if run.state == RunState.AWAITING_APPROVAL.value:
            run.state, run.ended_at = RunState.ABORTED.value, now()
        run.pause_reasons, run.is_given_up = [], True
        run.given_up = {
            "by": actor.printed_name,
            "by_id": str(actor.pk),
            "at": iso(now()),
            "reason": reason,
        }
        run.save(update_fields=["state", "ended_at", "pause_reasons", "is_given_up", "given_up"])
        account_services.write_audit("run.abort", str(run.id), actor=actor, reason=reason)
    stop_unstarted(run, reason)
    for job in Job.objects.filter(run=run, state__in=_AT_EDGE).select_for_update(no_key=True):
        attempt = selectors.last_attempt(job)
        if attempt is not None:
            dispatch.send_cancel(attempt, issued_by=str(actor.pk))
    halt_what_stands(run, actor)
    on_commit(partial(announce, run.id))
    return refresh_run(run_id)


def _held(run_id: UUID) -> Run:
    """Lock a run behind its hosts, as whoever dispatches does: nothing is sent in between."""
    rows = Job.objects.filter(run_id=run_id).values_list("device__host_id", flat=True)
    for host_id in sorted(set(rows)):
        enrollment_selectors.host_for_update(host_id)
    return selectors.run_for_update(run_id)


@atomic
def stop_device(device_id: UUID, *, actor: User) -> DeviceHalt:
    """Halt one device, whether anything acts on it or not; the runs that use it are paused.

    Asked for again while the first is under way it changes nothing.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: The actor may not stop it.
        StateError: No host serves it.

    Effect:
        The device is brought to its safe state within seconds, or as soon as it answers. What it
        was set to is unknown from then on. It may act again afterwards: it is no emergency stop.
    """
    device = enrollment_selectors.find_device(device_id)
    root = resource_selectors.root_of(device.host.lab)
    nodes = {UUID(node) for node in device.nodes.values()} or {root.id}
    resource_selectors.require(actor, Permission.STOP, nodes)
    if device.state != Device.State.ENROLLED:
        text = f"{device.name} is {device.state}: no host serves it, so nothing here can halt it"
        raise StateError(text, code="device.not_enrolled")
    enrollment_selectors.host_for_update(device.host_id)
    under_way = DeviceHalt.objects.filter(device=device, code=DEVICE_STOPPED, state__in=_OPEN)
    found = under_way.first()
    if found is None:
        found = _ask(device, None, DEVICE_STOPPED, actor)
        account_services.write_audit("device.stop", str(device.id), actor=actor)
    using = Job.objects.filter(device=device, state__in=_AT_EDGE).values("run_id")
    runs = Run.objects.filter(pk__in=using, is_given_up=False).order_by("pk")
    for run in runs.select_for_update(of=("self",), no_key=True):
        add_pause(run, "device_stopped", actor)
        recall_run(run, issued_by=str(actor.pk), is_whole=True)
        refresh_run(run.pk)
    return found


# --- what follows -------------------------------------------------------------------


def stop_unstarted(run: Run, reason: str) -> None:
    """Let nothing of a run begin that a host does not have, or has given back."""
    states = [state.value for state in UNSTARTED]
    for job in Job.objects.filter(run=run, state__in=states).select_for_update(no_key=True):
        tell_unbooked(job, reason)
        move_job(job, JobState.STOPPED, Mover.SERVER, message=reason)


def go_on_aborting(run: Run) -> None:
    """Do what an abort asks for after a job of its run has come further.

    A job that ends while its cancel is under way may have set its device for good, and one that
    its host gives back is not sent again.
    """
    if not run.is_given_up or run.state in _ENDED:
        return
    stop_unstarted(run, "the run was aborted")
    halt_what_stands(run, None)


def halt_what_stands(run: Run, actor: User | None) -> None:
    """Ask for the halt of each device that a given-up run has set and that still goes on.

    One that another live run works with is left alone, which is written down.
    """
    for device, jobs in _devices_of(run).items():
        asked = {HaltState(halt.state) for halt in run.halts.filter(device=device)}
        acts = any(job.state in _ACTING for job in jobs)
        standing = _standing(run, device)
        is_given_up = not asked and _is_in_question(device, jobs)
        wish = halt_wish(run.pk, asked, standing, acts=acts, may_stand=is_given_up)
        if wish is HaltState.ASKED:
            _ask(device, run, RUN_ABORTED, actor)
        elif wish is HaltState.KEPT:
            other = selectors.find_run(who_keeps(run.pk, standing) or run.pk)
            text = f"run #{other.number} works with it"
            _note(device, run, RUN_ABORTED, actor, HaltState.KEPT, text)


def _devices_of(run: Run) -> dict[Device, list[Job]]:
    """Return the devices that were sent anything for a run, with its jobs."""
    jobs = Job.objects.filter(run=run, attempts__isnull=False).distinct()
    found: dict[Device, list[Job]] = {}
    for job in jobs.select_related("device__host").order_by("device_id", "index"):
        found.setdefault(job.device, []).append(job)
    return found


def _standing(run: Run, device: Device) -> list[Set]:
    """Return what goes on at a device that the run has used, whichever run began it."""
    sent = Attempt.objects.filter(job__device=device, host=device.host)
    first = sent.filter(job__run=run).aggregate(first=Min("dseq"))["first"]
    since = sent.filter(Q(dseq__gte=first or 0) | Q(job__run__state__in=selectors.LIVE))
    rows = selectors.with_runs(Job.objects.filter(pk__in=since.values("job_id")))
    complete = rows.filter(state=JobState.COMPLETE.value).annotate(last=Max("attempts__dseq"))
    done = list(complete.order_by("last", "pk"))
    told = [Done(index=at, action=job.action, args=job.args) for at, job in enumerate(done)]
    found: list[Job] = [
        done[at] for at in still_standing(told) if not is_off_since(done[at].halted_by)
    ]
    acting = rows.filter(state__in=_AT_EDGE).exclude(run=run)
    found += [job for job in acting if leaves_standing(job.action, job.args)]
    return [Set(run_id=job.run_id, is_live=_is_live(job.run)) for job in found]


def _is_in_question(device: Device, jobs: list[Job]) -> bool:
    """Say whether a job of a run that was given up may have left its device going.

    Args:
        device: Which device.
        jobs: Those of the run that were sent to it.
    """
    given_up = {job.pk for job in jobs if _is_given_up(job)}
    if not given_up:
        return False
    sent = Attempt.objects.filter(job__device=device, host=device.host)
    first = sent.filter(job__in=given_up).aggregate(first=Min("dseq"))["first"]
    since = sent.filter(dseq__gte=first or 0).values("job_id")
    is_told = Q(state=JobState.COMPLETE.value) | Q(pk__in=given_up)
    rows = Job.objects.filter(is_told, pk__in=since).annotate(last=Max("attempts__dseq"))
    told = [
        Done(index=at, action=job.action, args=job.args, is_known=job.pk not in given_up)
        for at, job in enumerate(rows.order_by("last", "pk"))
    ]
    return bool(may_stand(told))


def _is_given_up(job: Job) -> bool:
    """Say whether a person has answered that nobody knows what a job did."""
    resolution = job.evidence.get("resolution") or {}
    return job.state == JobState.ABORTED.value and resolution.get("answer") == "discard"


def _is_live(run: Run) -> bool:
    return run.state in selectors.LIVE and not run.is_given_up


def _ask(device: Device, run: Run | None, code: str, actor: User | None) -> DeviceHalt:
    """Send one halt to the host of a device."""
    host = device.host
    if host.state in _GIVEN_UP:
        return _note(device, run, code, actor, HaltState.LOST, LOST)
    is_away = host.state not in _LISTENING
    state, text = (HaltState.OWED, AWAY) if is_away else (HaltState.ASKED, "")
    row = _note(device, run, code, actor, state, text)
    command = Halt(
        host_id=host.id,
        epoch=host.epoch,
        dseq=host.last_dseq,
        halt_id=row.pk,
        device_id=device.id,
        code=code,
        issued_by="" if actor is None else str(actor.pk),
    )
    dispatch.post(host, row.pk, command)
    return row


def _note(
    device: Device,
    run: Run | None,
    code: str,
    actor: User | None,
    state: HaltState,
    text: str,
) -> DeviceHalt:
    ended_at = None if state in OPEN_HALTS else now()
    row = DeviceHalt.objects.create(
        id=new_id(),
        device=device,
        host=device.host,
        run=run,
        code=code,
        state=state.value,
        message=text,
        asked_by=actor,
        at=now(),
        ended_at=ended_at,
    )
    _tell([row])
    return row


# --- what hosts tell ----------------------------------------------------------------

HALT_KINDS = frozenset({"halt_taken", "halt_waits"})


def take_halt_word(host: EdgeHost, event: EdgeEvent) -> None:
    """Note that a host has a halt on disk, or why it has not delivered one yet."""
    body = event.body
    if event.kind == "halt_taken":
        halt_id = UUID(body["halt_id"])
        dispatch.settle_outbox(halt_id, ["halt"])
        rows = DeviceHalt.objects.filter(pk=halt_id, host=host, state__in=_OPEN)
        if body.get("is_served") is True:
            _move(rows, HaltState.TAKEN, "")
        else:
            _move(rows, HaltState.LOST, f"{host.name} does not serve it: look at it yourself")
        return
    waiting = DeviceHalt.objects.filter(device_id=UUID(body["device_id"]), host=host)
    rows = waiting.filter(state__in=_OPEN, taken_at__isnull=False)
    _move(rows, HaltState.OWED, str(body.get("message", ""))[:1000])


def note_delivered(host: EdgeHost, event: EdgeEvent) -> None:
    """Note that the halts of a device that a host had on disk are delivered."""
    text = str(event.body.get("message") or "")[:1000]
    if not text:  # halted with an action; what is owed besides is delivered by itself
        return
    waiting = DeviceHalt.objects.filter(device_id=UUID(event.body["device_id"]), host=host)
    rows = waiting.filter(state__in=_OPEN, taken_at__isnull=False)
    if _move(rows, HaltState.HALTED, text):
        wake_dispatcher()


def note_journal_gone(host: EdgeHost, *, is_lost: bool) -> None:
    """Ask again for halts that a host had on disk, in a journal that counts no more.

    Args:
        host: Which.
        is_lost: It was declared lost, or revoked: it hears nothing any more.
    """
    rows = DeviceHalt.objects.filter(host=host, state__in=_OPEN)
    if is_lost:
        _move(rows, HaltState.LOST, LOST)
        return
    taken = rows.filter(taken_at__isnull=False).values_list("pk", flat=True)
    sent = Outbox.objects.filter(action_id__in=list(taken), kind="halt")
    sent.update(settled_at=None, published_at=None)
    _move(rows, HaltState.OWED, AWAY)


@atomic
def note_silence() -> int:
    """Say of halts about which nobody has told anything why: a run need not wait for that.

    Returns:
        How many.
    """
    undecided = DeviceHalt.objects.filter(state__in=[one.value for one in UNDECIDED])
    if not undecided.exists():
        return 0
    away = undecided.exclude(host__state__in=_LISTENING)
    late = undecided.filter(at__lt=now() - timedelta(seconds=SILENT_AFTER_S))
    return _move(away, HaltState.OWED, AWAY) + _move(late, HaltState.OWED, NO_WORD)


def _move(rows: Iterable[DeviceHalt], state: HaltState, text: str) -> int:
    """Take halts on, and bring the runs that wait for them in line."""
    found = list(rows)
    for row in found:
        row.state, row.message = state.value, text
        if state is HaltState.TAKEN:
            row.taken_at = now()
        if state not in OPEN_HALTS:
            row.ended_at = now()
        row.save(update_fields=["state", "message", "taken_at", "ended_at"])
    _tell(found)
    for run_id in sorted({row.run_id for row in found if row.run_id is not None}):
        refresh_run(run_id)
    return len(found)


def _tell(rows: Iterable[DeviceHalt]) -> None:
    for row in rows:
        on_commit(partial(feed.publish, "devices", {"device_id": str(row.device_id)}))
        if row.run_id is not None:
            on_commit(partial(announce, row.run_id))
