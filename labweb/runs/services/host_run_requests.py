"""Wishes of nodes beside a host: each becomes an ordinary run that a person approves."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any
from uuid import UUID

from django.db import IntegrityError
from django.db.transaction import atomic

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import DefinitionError, ForbiddenError, LabError, StateError
from labweb.domain.messages.action_asks import MOST_ARGUMENTS_BYTES, ActionAsk, AskTold
from labweb.domain.runs.states.job_states import FINAL, JobState, RunState
from labweb.domain.workflows import workflow_file
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs import selectors
from labweb.runs.models import Job, Run
from labweb.runs.services.planning.start import StartWish, start_run
from labweb.runs.services.stopping.abort import abort_run
from labweb.workflows import selectors as workflow_selectors
from labweb.workflows import services as workflow_services
from labweb.workflows.selectors import WorkflowVersion

RULE = "Asked by a node beside a host"
WITHDRAWN = "withdrawn by the node that asked"
MOST_OPEN = 20
"""Runs of one host's wishes that have not ended; more are refused."""

_STEP = "asked"
_ENDED = [RunState.COMPLETE.value, RunState.ABORTED.value]


@atomic
def let_ask(host_id: UUID, *, name: User | None, actor: User) -> EdgeHost:
    """Say in whose name nodes beside a host may ask for actions; None: they may not.

    Raises:
        ForbiddenError: The actor may not admit here, or the person may not run anything.
    """
    host = enrollment_selectors.host_for_update(host_id)
    root = resource_selectors.root_of(host.lab)
    resource_selectors.require(actor, Permission.ADMIT, [root.id])
    if name is not None:
        resource_selectors.require(name, Permission.RUN, [root.id])
    host.asks_as = name
    host.save(update_fields=["asks_as"])
    detail = {"as": None if name is None else name.get_username()}
    account_services.write_audit("host.let_ask", str(host.id), actor=actor, detail=detail)
    return host


def take_ask(host_id: UUID, ask: ActionAsk) -> AskTold:
    """Turn a wish into a run that waits for approval; the same one twice is one run.

    Effect:
        Nothing moves before a person approves the run, and then by signed commands alone.
    """
    try:
        return _told(_start(host_id, ask))
    except IntegrityError:
        return AskTold(ask_id=ask.ask_id, state="refused", is_final=True, message="it was asked")
    except LabError as error:
        return AskTold(ask_id=ask.ask_id, state="refused", is_final=True, message=error.message)


@atomic
def _start(host_id: UUID, ask: ActionAsk) -> Run:
    known = Run.objects.filter(ask_id=ask.ask_id).first()
    if known is not None:
        if not Run.objects.filter(pk=known.pk, ask_host_id=host_id).exists():
            raise ForbiddenError("another host asked for this", code="ask.other_host")
        return known
    host = enrollment_selectors.host_for_update(host_id)
    actor = host.asks_as
    if actor is None or not actor.is_active:
        raise ForbiddenError("nodes beside this host may not ask for actions", code="ask.off")
    if len(json.dumps(ask.args)) > MOST_ARGUMENTS_BYTES:
        raise DefinitionError("the arguments are too long", code="ask.too_long")
    if Run.objects.filter(ask_host=host).exclude(state__in=_ENDED).count() >= MOST_OPEN:
        raise StateError(f"{MOST_OPEN} wishes of this host wait already", code="ask.too_many")
    device = enrollment_selectors.find_device(ask.device_id)
    if device.host_id != host_id:
        raise ForbiddenError("this host does not have that device", code="ask.other_host")
    name = f"{device.name}: {ask.action.replace('_', ' ')}"[:180] + f" ({ask.source[:10]})"
    document: dict[str, Any] = {
        "schema": workflow_file.SCHEMA,
        "name": name,
        "steps": [
            {
                "id": _STEP,
                "kind": "device_action",
                "params": {
                    "device": next(iter(device.nodes.values())),
                    "action": ask.action,
                    "args": ask.args,
                },
                "position": {"x": 0, "y": 0},
                "note": f"Asked over {ask.source[:40]}",
            }
        ],
        "edges": [],
    }
    version = _version(host.lab, document, actor)
    wish = StartWish(ask.ask_id, host_id, RULE)
    run = start_run(version, actor=actor, wish=wish)
    detail = {"host_id": str(host_id), "source": ask.source[:40]}
    account_services.write_audit("run.asked", str(run.id), actor=actor, detail=detail)
    return run


def _version(lab: Lab, document: dict[str, Any], actor: User) -> WorkflowVersion:
    """Freeze the wish as a version; all wishes for one action are versions of one workflow."""
    known = workflow_selectors.find_named(lab, document["name"], author=actor)
    if known is None or [step.get("id") for step in known.draft.get("steps", [])] != [_STEP]:
        known = workflow_services.create_workflow(
            lab, name=document["name"], document=document, actor=actor
        )
    elif known.draft != document:
        workflow_services.save_draft(
            known.id, document=document, revision=known.draft_revision, actor=actor
        )
    return workflow_services.save_version(known.id, note=RULE, actor=actor)


def withdraw_ask(host_id: UUID, ask_id: UUID) -> None:
    """Give up the run of a wish: what has not begun is not begun, what acts goes on to its end."""
    run = Run.objects.filter(ask_id=ask_id, ask_host_id=host_id).first()
    if run is None or run.state in _ENDED:
        return
    try:
        abort_run(run.id, actor=run.created_by, reason=WITHDRAWN)
    except StateError:
        return  # it has ended meanwhile


def asks_told(host_id: UUID, ask_ids: Iterable[UUID]) -> list[AskTold]:
    """Return what has become of wishes."""
    rows = Run.objects.filter(ask_host_id=host_id, ask_id__in=list(ask_ids))
    return [_told(run) for run in rows.prefetch_related("jobs")]


def _told(run: Run) -> AskTold:
    jobs: list[Job] = list(selectors.jobs_of(run))
    last = next((job for job in jobs if job.state != JobState.COMPLETE.value), jobs[-1])
    is_final = run.state in _ENDED or JobState(last.state) in FINAL
    return AskTold(
        ask_id=run.ask_id or run.id,
        state=last.state,
        is_final=is_final,
        run_number=run.number,
        message=last.message,
        evidence=last.evidence if is_final else {},
    )
