"""Compile, ask policies, and put a run into the queue."""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import dataclass, replace
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
from labweb.common.clock import now
from labweb.common.prepared import insert_rows, together
from labweb.common.wake import wake_dispatcher
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd import services as crutd_services
from labweb.crutd.selectors.facts import lab_facts
from labweb.domain.approvals.roles import Permission
from labweb.domain.crutd import operations
from labweb.domain.crutd.decide import ResourceState
from labweb.domain.errors import Finding, PreconditionError, RevisionError
from labweb.domain.resources.contents import LotId
from labweb.domain.runs.job import JobState, Mover, RunState
from labweb.domain.workflows import plan as plans
from labweb.domain.workflows.agreement.contents import check_contents
from labweb.domain.workflows.compile import LabView, compile_workflow
from labweb.domain.workflows.plan import Plan
from labweb.domain.workflows.protocol import parse_workflow
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab, Resource
from labweb.runs import selectors
from labweb.runs.models import Job, Run
from labweb.runs.services.state import announce, move_job, refresh_run
from labweb.telemetry import selectors as telemetry_selectors
from labweb.workflows.selectors import WorkflowVersion

_REQUEST_LIFE = timedelta(hours=24)


def lab_view(lab: Lab) -> LabView:
    """Return the frozen picture of a lab that compiling works on."""
    rows: list[Resource]
    devices: list[Device]
    rows, devices, lots, materials, connections = together(
        resource_selectors.NODES.asking(lab=lab.pk),
        enrollment_selectors.TO_PLAN.asking(lab=lab.pk),
        resource_selectors.LOTS.asking(lab=lab.pk),
        resource_selectors.MATERIALS.asking(lab=lab.pk),
        resource_selectors.CONNECTIONS.asking(lab=lab.pk),
    )
    specs = enrollment_selectors.specs_of(devices)
    calibrations = selectors.calibrations_of(devices, at=now())
    return LabView(
        tree=resource_selectors.tree_of(rows),
        graph=resource_selectors.to_graph(connections),
        devices=tuple(
            msgspec.structs.replace(
                enrollment_selectors.to_domain(row, specs[row.id]),
                calibrations=calibrations.get(row.id, ()),
            )
            for row in devices
        ),
        snapshot=_as_devices_say(crutd_selectors.lab_snapshot(rows), devices),
        densities_mg_ul={LotId(str(lot.id)): lot.material.density_mg_ul for lot in lots},
        facts=lab_facts(lab, lots, materials),
        lots={lot.key: LotId(str(lot.id)) for lot in lots},
        materials={row.key: row.id for row in materials},
    )


def _as_devices_say(
    snapshot: dict[UUID, ResourceState], devices: list[Device]
) -> dict[UUID, ResourceState]:
    """Put what a device last told of its own state over the record of it.

    A pump that was switched off has lost its zero, whatever was recorded before.
    """
    told = telemetry_selectors.latest_of("is_initialized", [row.id for row in devices])
    found = dict(snapshot)
    for row in devices:
        if told.get(row.id) is not False:
            continue
        for node in (UUID(text) for text in row.nodes.values()):
            state = found[node]
            if "is_initialized" in state.data:
                data = {**state.data, "is_initialized": False}
                found[node] = replace(state, data=data)
    return found


@dataclass(frozen=True, slots=True)
class Preview:
    """What a start would mean now."""

    plan: Plan
    policies: tuple[str, ...]
    """Names of the policies that want a person to look first."""


def preview(
    lab: Lab,
    document: dict[str, Any],
    *,
    view: LabView | None = None,
    reach: resource_selectors.Reach | None = None,
) -> Preview:
    """Compile a workflow document against the lab as it is.

    Args:
        lab: The lab.
        document: The workflow.
        view: The lab as it was read already; None reads it.
        reach: Where the asker has the permission that they need on all that the document
            names and its plan uses; None: nobody asks.

    Raises:
        ForbiddenError: They lack it on one of these. Told before anything is compiled where
            the document names it: findings tell what is in the vessels they speak of.
        ProtocolError: The document is malformed; findings list each place.
        PlanningError: This lab cannot do it; findings list each reason.

    Effect:
        None.
    """
    view = view or lab_view(lab)
    if reach is not None:
        reach.require(_named(view, document))
    plan = compile_workflow(parse_workflow(document), view)
    if reach is not None:
        reach.require(touched(plan))
    names = tuple(policy.name for policy in approval_services.asking_policies(lab, plan))
    return Preview(plan, names)


def touched(plan: Plan) -> set[UUID]:
    """Return every resource a plan uses."""
    ids = {node for job in plan.jobs for node in job.locks}
    for job in plan.jobs:
        if not isinstance(job.operation, operations.Read):
            ids.update(operations.touched_ids(job.operation))
    return ids


def _named(view: LabView, document: dict[str, Any]) -> set[UUID]:
    """Return the resources that a document names, by id or key."""
    texts = set(_texts(document))
    return {
        node.id for node in view.tree.resources if str(node.id) in texts or f"@{node.key}" in texts
    }


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value.strip().lower()
        yield value.strip()
    elif isinstance(value, dict | list):
        for child in value.values() if isinstance(value, dict) else value:
            yield from _texts(child)


@dataclass(frozen=True, slots=True)
class Wish:
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
    wish: Wish | None = None,
) -> Run:
    """Compile a version against the lab as it is and queue it, or ask for approval.

    `seen_digest` is of the plan that the actor saw; None agrees to the present one. A wish
    always asks for approval.

    Raises:
        RevisionError: The plan is not the one the actor saw; nothing was written.
        ProtocolError, PlanningError: As `preview`; nothing was written.
        ForbiddenError: The actor may not run things on some resource of the plan.
        PreconditionError: The lab is stopped, or a vessel holds what nobody proved the recipe with.
        LockedError: Somebody else has reserved a resource of the plan.

    Effect:
        Nothing moves before the dispatcher sends the first job.
    """
    lab = resource_selectors.lab_for_update(version.workflow.lab_id)
    if lab.is_stopped:
        finding = Finding("run.lab_stopped", "the lab is stopped: a person has to reset it first")
        raise PreconditionError(finding.message, code=finding.code, findings=[finding])
    reach = resource_selectors.reach_of(actor, Permission.RUN)
    view = lab_view(lab)
    found = preview(lab, version.document, view=view, reach=reach)
    check_proved(version, view)
    crutd_services.refuse_reserved_by_others(touched(found.plan), actor_id=actor.pk)
    plan_digest = plans.digest(found.plan)
    _check_seen(plan_digest, seen_digest)
    policies = found.policies if wish is None else (*found.policies, wish.rule)
    needs_person = bool(policies)
    state = RunState.AWAITING_APPROVAL if needs_person else RunState.QUEUED
    run = Run(
        lab=lab,
        number=selectors.next_run_number(lab),
        version=version,
        plan=msgspec.to_builtins(found.plan),
        plan_digest=plan_digest,
        state=state.value,
        created_by=actor,
        created_at=now(),
        ask_id=None if wish is None else wish.ask_id,
        ask_host_id=None if wish is None else wish.host_id,
    )
    insert_rows([run])
    job_state = JobState.AWAITING_APPROVAL if needs_person else JobState.QUEUED
    write_jobs(run, found.plan, job_state)
    if needs_person:
        _ask(run, policies, actor)
    else:
        wake_dispatcher()
    account_services.write_audit(
        "run.start", str(run.id), actor=actor, detail={"plan_digest": plan_digest}
    )
    on_commit(partial(announce, run.id))
    return run


def check_proved(
    version: WorkflowVersion, view: LabView, among: Container[UUID] | None = None
) -> None:
    """Refuse a recipe whose vessels hold something else than when it was proved.

    Raises:
        PreconditionError: `recipe.other_content`; `findings` list each vessel.
    """
    findings = [] if version.proved is None else check_contents(version.proved, view, among)
    if findings:
        first = findings[0]
        raise PreconditionError(first.message, code=first.code, findings=findings)


def _check_seen(plan_digest: str, seen_digest: str | None) -> None:
    if seen_digest is not None and seen_digest != plan_digest:
        raise RevisionError(
            "the plan is not the one that was seen: the workflow or the lab has changed since",
            code="run.plan_changed",
            context={"plan_digest": plan_digest},
        )


def write_jobs(run: Run, plan: Plan, state: JobState) -> None:
    """Write the jobs of a plan."""
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
            after=list(job.after),
            locks=[str(node) for node in job.locks],
            recovery=job.recovery,
            estimate_s=job.estimate_s,
            state=state.value,
            state_at=at,
        )
        for job in plan.jobs
    ]
    insert_rows(rows)


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
        reason = {"kind": "stopped", "by": actor.printed_name, "at": now().isoformat()}
        run.pause_reasons = [reason]
    run.state = RunState.QUEUED.value if is_approved else RunState.ABORTED.value
    run.ended_at = None if is_approved else now()
    run.save(update_fields=["state", "ended_at", "pause_reasons"])
    if is_approved:
        refresh_run(run.id)
    on_commit(partial(announce, run.id))
    return request
