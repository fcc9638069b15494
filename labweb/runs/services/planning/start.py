"""Compile, ask policies, and put a run into the queue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.approvals import selectors as approval_selectors
from labweb.approvals import services as approval_services
from labweb.approvals.selectors import ApprovalRequest
from labweb.common import disk
from labweb.common.clock import now
from labweb.common.database.prepared_queries import Question, inserting, together
from labweb.common.dispatcher_wakeup import waking
from labweb.crutd import services as crutd_services
from labweb.crutd.selectors import reservations
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd import operations
from labweb.domain.disk_space import check_room
from labweb.domain.errors import (
    Finding,
    PreconditionError,
    RevisionError,
    StateError,
)
from labweb.domain.runs.states.job_states import JobState, Mover, RunState
from labweb.domain.workflows import plan as plans
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.plan import Plan
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs import selectors
from labweb.runs.models import Job, Run
from labweb.runs.selectors.run_holds import claims_of_plan
from labweb.runs.services.execution.job_states import announce, move_job, refresh_run
from labweb.runs.services.planning.lab_view import asking_view, hosts_in, lab_view, view_of
from labweb.runs.services.planning.preview import named, preview, surely_touched
from labweb.runs.services.planning.proof_departures import check_proved
from labweb.workflows.selectors import WorkflowVersion

_REQUEST_LIFE = timedelta(hours=24)


@dataclass(frozen=True, slots=True)
class StartWish:
    """A node beside a host asked for the run, in the actor's name."""

    ask_id: UUID
    host_id: UUID
    rule: str
    """What a person has to look at it for."""


@atomic
def start_run(
    version: WorkflowVersion,
    *,
    actor: User,
    seen_digest: str | None = None,
    wish: StartWish | None = None,
    is_asked: bool = False,
) -> Run:
    """Compile a version against the lab as it is and queue it, or ask for approval.

    `seen_digest` is of the plan that the actor saw; None agrees to the present one. A wish
    always asks for approval. `is_asked`: a second run is refused until the first has begun.

    Raises:
        StateError: `run.already_waiting`: a run of this version has not begun.
        RevisionError: The plan is not the one the actor saw; nothing was written.
        ProtocolError, PlanningError: As `preview`; nothing was written.
        ForbiddenError: The actor may not run things on some resource of the plan.
        PreconditionError: The lab is stopped, a disk is full, or a vessel has not what was proved.
        LockedError: Somebody else has reserved a resource of the plan.

    Effect:
        Nothing moves before the dispatcher sends the first job.
    """
    scene = hold_scene(version.workflow.lab_id, actor)
    lab, view = scene.lab, scene.view
    _admit(version, scene, actor, is_asked=is_asked)
    found = preview(lab, version.document, view=view, reach=scene.reach, rules=scene.rules)
    _check_room(found.plan, scene.hosts)
    check_proved(version, view)
    crutd_services.refuse_reserved_by_others(
        surely_touched(found.plan), actor_id=actor.pk, is_any=scene.is_any_reserved
    )
    plan_digest = _seen_digest(found.plan, seen_digest)
    policies = found.policies if wish is None else (*found.policies, wish.rule)
    run = Run(
        lab=lab,
        number=scene.run_number,
        version=version,
        plan=found.to_json(),
        plan_digest=plan_digest,
        claims=_claimed(found.plan, view),
        state=(RunState.AWAITING_APPROVAL if policies else RunState.QUEUED).value,
        created_by=actor,
        created_at=now(),
        ask_id=None if wish is None else wish.ask_id,
        ask_host_id=None if wish is None else wish.host_id,
    )
    rows = [inserting([run]), *_inserting_jobs(run, found.plan, JobState(run.state))]
    last = None
    if policies:
        together(*rows)
        _ask(run, policies, actor)
    else:
        *_, last = together(*rows, waking(), *account_services.end_of_audit())
    account_services.write_audit(
        "run.start", str(run.id), actor=actor, detail={"plan_digest": plan_digest}, after=last
    )
    on_commit(partial(announce, run.id))
    return run


def _claimed(plan: Plan, view: PlannerView) -> dict[str, Any]:
    """Return what any path of a plan may use, as it is stored."""
    kinds = {one.id: one.kind for one in view.tree.resources}
    claims: dict[str, Any] = msgspec.to_builtins(claims_of_plan(plan, kinds), str_keys=True)
    return claims


@dataclass(frozen=True, slots=True)
class StartScene:
    """All that a start asks of a lab, which is locked."""

    lab: Lab
    reach: resource_selectors.Reach
    rules: list[approval_selectors.Policy]
    is_any_reserved: bool
    """By somebody else."""

    run_number: int
    view: PlannerView
    hosts: dict[UUID, EdgeHost]
    """By each device that was admitted."""


def hold_scene(lab_id: UUID, actor: User) -> StartScene:
    """Lock the lab, and read under the lock all that a start asks of it; one exchange.

    Raises:
        NotFoundError: There is no such lab.
    """
    may = Permission.RUN
    labs, allowed, rules, reserved, numbers, *answers = together(
        resource_selectors.LAB_TO_LOCK.asking(id=lab_id),
        resource_selectors.asking_allowed(actor, may),
        approval_selectors.RULES.asking(lab=lab_id),
        reservations.asking_any_live(actor.pk),
        selectors.asking_run_number(lab_id),
        *asking_view(lab_id),
    )
    lab = resource_selectors.locked(labs, lab_id)
    ids = resource_selectors.allowed_of(allowed, actor, may)
    return StartScene(
        lab=lab,
        reach=resource_selectors.Reach(actor, may, ids),
        rules=rules,
        is_any_reserved=bool(reserved),
        run_number=numbers[0],
        view=view_of(lab, answers),
        hosts=hosts_in(answers),
    )


def _admit(version: WorkflowVersion, scene: StartScene, actor: User, *, is_asked: bool) -> None:
    """Refuse who may not start it before anything is told of the lab and of other runs."""
    scene.reach.require(named(scene.view, version.document))
    if scene.lab.is_stopped:
        finding = Finding("run.lab_stopped", "the lab is stopped: a person has to reset it first")
        raise PreconditionError(finding.message, code=finding.code, findings=[finding])
    _refuse_second(version, actor, is_asked=is_asked)


def _check_room(plan: Plan, hosts: Mapping[UUID, EdgeHost]) -> None:
    """Refuse a start for which the server, or a host that will act, has too little room."""
    used = {
        host.pk: host
        for job in plan.jobs
        for way in job.ways()
        if (host := hosts.get(way.device_id)) is not None
    }
    server = disk.server_disk()
    told = [one for _, one in enrollment_selectors.disks_of(used.values())]
    findings = check_room([*([] if server is None else [server]), *told], disk.floors())
    if findings:
        raise PreconditionError(findings[0].message, code=findings[0].code, findings=findings)


def _seen_digest(plan: Plan, seen_digest: str | None) -> str:
    """Return the digest of a plan, which has to be the one that was seen; None: any is."""
    plan_digest = plans.digest(plan)
    if seen_digest is not None and seen_digest != plan_digest:
        raise RevisionError(
            "the plan is not the one that was seen: the workflow or the lab has changed since",
            code="run.plan_changed",
            context={"plan_digest": plan_digest},
        )
    return plan_digest


def _refuse_second(version: WorkflowVersion, actor: User, *, is_asked: bool) -> None:
    """Refuse a start while another run of the version has not begun; name those the actor sees."""
    waiting = selectors.waiting_runs(version.id) if is_asked else []
    if not waiting:
        return
    seen = resource_selectors.allowed_ids(actor, Permission.VIEW)
    shown = selectors.visible_runs(version.workflow.lab, seen).filter(
        pk__in=[run.pk for run in waiting]
    )
    runs = [{"id": str(run.id), "number": run.number, "state": run.state} for run in shown]
    names = ", ".join(f"run #{run['number']}" for run in runs) or "a run that you may not see"
    raise StateError(
        f"{names} of this version has not begun: a second run does everything once more. "
        "Say that you want a second one (is_second), or wait",
        code="run.already_waiting",
        context={"runs": runs},
    )


def write_jobs(run: Run, plan: Plan, state: JobState) -> None:
    """Write the jobs of a plan."""
    together(*_inserting_jobs(run, plan, state))


def _inserting_jobs(run: Run, plan: Plan, state: JobState) -> list[Question[Any]]:
    at = now()
    rows = [
        Job(
            run=run,
            index=job.index,
            step_id=job.step_id,
            sentence=job.sentence,
            device_id=job.device_id,
            action=job.action,
            args=job.args,
            operation=operations.to_json(job.operation),
            pre=msgspec.to_builtins(job.pre),
            post=msgspec.to_builtins(job.post),
            corrections=msgspec.to_builtins(job.corrections),
            choices=msgspec.to_builtins(job.choices or ()),
            after=list(job.after),
            meets=job.meets if isinstance(job.meets, int) else None,
            asks=job.asks or "",
            states=msgspec.to_builtins(job.states) if job.states else None,
            locks=[str(node) for node in job.locks],
            recovery=job.recovery,
            estimate_s=job.estimate_s,
            state=state.value,
            state_at=at,
        )
        for job in plan.jobs
    ]
    return [inserting(rows)] if rows else []


def _ask(run: Run, policies: tuple[str, ...], actor: User) -> ApprovalRequest:
    return approval_services.open_request(
        lab=run.lab,
        title=f"Start {run.version.workflow.name} v{run.version.number}",
        run_id=run.id,
        plan_digest=run.plan_digest,
        policies=policies,
        asked_by=actor,
        expires_at=now() + _REQUEST_LIFE,
    )


@atomic
def decide_request(
    request_id: UUID, *, actor: User, is_approved: bool, comment: str
) -> ApprovalRequest:
    """Answer a request; an approval releases exactly the plan that was shown.

    Raises:
        StateError: Somebody answered before, or it expired.
        ForbiddenError: The actor asked it, or lacks the permission.
        PreconditionError: It is approved, and meanwhile a vessel holds what nobody proved the
            recipe with. The request stays open.

    Effect:
        Approved: the run is queued. Rejected: it ends without having begun.
    """
    run = selectors.run_for_update(
        approval_selectors.run_of(approval_selectors.find_request(request_id))
    )
    request = approval_services.decide(
        request_id, actor=actor, is_approved=is_approved, comment=comment
    )
    if is_approved and run.version.proved is not None:
        check_proved(run.version, lab_view(run.lab))
    target = JobState.QUEUED if is_approved else JobState.STOPPED
    for job in Job.objects.filter(run=run, state=JobState.AWAITING_APPROVAL.value):
        move_job(job, target, Mover.SERVER)
    if is_approved and run.lab.is_stopped and not run.pause_reasons:
        by = None if run.lab.stopped_by is None else run.lab.stopped_by.printed_name
        reason = {"kind": "stopped", "by": by, "at": now().isoformat()}
        run.pause_reasons = [reason]
    run.state = RunState.QUEUED.value if is_approved else RunState.ABORTED.value
    run.ended_at = None if is_approved else now()
    run.save(update_fields=["state", "ended_at", "pause_reasons"])
    if is_approved:
        refresh_run(run.id)
    on_commit(partial(announce, run.id))
    return request
