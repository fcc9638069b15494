"""The endpoints of workflows: list, open, check against the lab."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any, ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.common.answers import NumberedRef
from labweb.common.lists import STANDING
from labweb.common.requests import body
from labweb.domain.approvals.access_tokens import AccessScope
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import Finding, LabError
from labweb.domain.runs.states.job_states import RunState
from labweb.domain.workflows import plan as plans
from labweb.domain.workflows.unit_operations.step_palette import STEP_KINDS, sentence
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs import selectors, services
from labweb.runs.answers.workflows import (
    DraftProof,
    LastRunOf,
    WordsOfStep,
    WorkflowCheck,
    WorkflowDetail,
    WorkflowOverview,
    WorkflowOverviewList,
    check_findings,
)
from labweb.runs.api import run_details
from labweb.workflows import selectors as workflow_selectors
from labweb.workflows.api import workflows as workflow_api
from labweb.workflows.selectors import Workflow


class CheckDocument(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a check."""

    document: dict[str, Any]
    workflow_id: UUID | None = None
    """Workflow that it is a draft of, whose proofs are then compared with it."""


class DraftCheck(Endpoint):
    """What a workflow would mean here and now."""

    scopes: ClassVar[Mapping[str, AccessScope]] = {"post": AccessScope.DRAFT}
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": CheckDocument}
    harmless: ClassVar[Mapping[str, str]] = {"post": "it calculates and writes nothing"}

    def post(self, request: Request) -> WorkflowCheck:
        """Compile a document against the lab as it is; findings are an answer, no failure."""
        user = user_of(request)
        wanted = body(request, CheckDocument)
        document = wanted.document
        lab = resource_selectors.the_lab()
        reach = resource_selectors.reach_of(user, Permission.VIEW)
        view = services.lab_view(lab)
        hidden = {str(node.id) for node in view.tree.resources if node.id not in reach.ids}
        names = {key: name for key, name in view.names.items() if key not in hidden}
        answer = WorkflowCheck(
            findings=[],
            plan=None,
            policies=[],
            sentences=_sentences(document, names),
            proof=None
            if wanted.workflow_id is None
            else _proof(workflow_selectors.find_visible(wanted.workflow_id, user), document),
        )
        try:
            found = services.preview(lab, document, view=view, reach=reach)
        except LabError as error:
            answer.findings = check_findings(error.findings or [Finding(error.code, error.message)])
            return answer
        answer.plan = run_details.plan_view(found.to_json(), plans.digest(found.plan), names)
        answer.policies = list(found.policies)
        return answer


def _proof(row: Workflow, document: dict[str, Any]) -> DraftProof | None:
    """Say which version's proof a draft has, or what took it away; None: there is none."""
    found = workflow_selectors.proof_of(row, document)
    if found is None:
        return None
    return DraftProof(version=found.version.number, changes=check_findings(found.changes))


def _sentences(document: dict[str, Any], names: dict[str, str]) -> dict[str, list[WordsOfStep]]:
    steps = document.get("steps")
    found: dict[str, list[WordsOfStep]] = {}
    for step in steps if isinstance(steps, list) else []:
        kind = step.get("kind") if isinstance(step, dict) else None
        if not isinstance(kind, str) or kind not in STEP_KINDS:
            continue
        params = step.get("params")
        known = params if isinstance(params, dict) else {}
        found[str(step.get("id"))] = [WordsOfStep(**part) for part in sentence(kind, known, names)]
    return found


class Workflows(Endpoint):
    """Workflows with their last runs."""

    scopes: ClassVar[Mapping[str, AccessScope]] = {"post": AccessScope.DRAFT}
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": workflow_api.NewWorkflow}
    statuses: ClassVar[Mapping[str, int]] = {"post": 201}
    queries = STANDING.parameters

    def get(self, request: Request) -> WorkflowOverviewList:
        """List workflows, templates first, then the newest."""
        lab = resource_selectors.the_lab()
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        rows = workflow_selectors.visible_workflows(lab, seen)
        found, following = STANDING.of_list(request, rows, _place)
        return WorkflowOverviewList(workflows=_rendered(lab, found), next=following)

    def post(self, request: Request) -> WorkflowDetail:
        """Create a workflow."""
        row = workflow_api.create(request)
        return _workflow(row.id, user_of(request))


class OneWorkflow(Endpoint):
    """One workflow."""

    def get(self, request: Request, workflow_id: UUID) -> WorkflowDetail:
        """Return a workflow with its draft and versions."""
        return _workflow(workflow_id, user_of(request))


def workflow_rows(lab: Lab, seen: Collection[UUID]) -> list[WorkflowOverview]:
    """Render workflows with the last run of each; a fixed number of queries."""
    return _rendered(lab, workflow_selectors.visible_workflows(lab, seen))


def _rendered(lab: Lab, rows: Iterable[Workflow]) -> list[WorkflowOverview]:
    last = selectors.last_runs(lab)
    return [_overview(row, last.get(row.id)) for row in rows]


def _overview(row: Workflow, last: selectors.LastRun | None) -> WorkflowOverview:
    newest = max(row.versions.all(), key=lambda version: version.number, default=None)
    steps = row.draft.get("steps")
    return WorkflowOverview(
        id=row.id,
        name=row.name,
        description=row.description,
        is_template=row.is_template,
        latest_version=None if newest is None else NumberedRef(id=newest.id, number=newest.number),
        steps_count=len(steps) if isinstance(steps, list) else 0,
        updated_at=row.updated_at,
        updated_by=None if row.created_by is None else row.created_by.printed_name,
        last_run=_last_run(last),
    )


def _place(row: Workflow) -> list[Any]:
    return [not row.is_template, -row.updated_at.timestamp(), str(row.pk)]


def _last_run(last: selectors.LastRun | None) -> LastRunOf | None:
    if last is None:
        return None
    return LastRunOf(
        id=last.run.id,
        number=last.run.number,
        state=RunState(last.run.state),
        ended_at=last.run.ended_at,
        waits_for=last.waits_for,
    )


def _workflow(workflow_id: UUID, user: User) -> WorkflowDetail:
    row = workflow_selectors.find_visible(workflow_id, user)
    last = selectors.last_runs(row.lab)
    return WorkflowDetail(
        **msgspec.structs.asdict(_overview(row, last.get(row.id))),
        draft=row.draft,
        draft_revision=row.draft_revision,
        versions=[workflow_api.version_row(v) for v in row.versions.all()],
        can_edit=Permission.DRAW in resource_selectors.permissions_on_all(user),
    )
