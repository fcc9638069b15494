"""Reads of workflows and versions."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from django.db.models import Prefetch, QuerySet, UUIDField

from labweb.accounts.selectors import User
from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import Finding, NotFoundError
from labweb.domain.recipes.agreement.keeping import changes_since
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.workflows.models import Workflow as Workflow
from labweb.workflows.models import WorkflowVersion as WorkflowVersion


def workflows_of(lab: Lab) -> QuerySet[Workflow]:
    """Workflows of a lab with their versions, templates first, then the newest."""
    versions = Prefetch(
        "versions", queryset=WorkflowVersion.objects.select_related("author").defer("document")
    )
    return (
        Workflow.objects.filter(lab=lab)
        .select_related("created_by")
        .prefetch_related(versions)
        .order_by("-is_template", "-updated_at")
    )


def versions_of(workflow: Workflow) -> QuerySet[WorkflowVersion]:
    """Versions of a workflow without their documents, the newest first."""
    return workflow.versions.select_related("author").defer("document").order_by("-number")


def find_workflow(workflow_id: UUID) -> Workflow:
    """Return a workflow.

    Raises:
        NotFoundError: There is none.
    """
    row = Workflow.objects.filter(pk=workflow_id).select_related("lab", "created_by").first()
    if row is None:
        raise NotFoundError(f"no workflow {workflow_id}", code="workflow.not_found")
    return row


def visible_workflows(lab: Lab, seen: Collection[UUID]) -> list[Workflow]:
    """Return the workflows of a lab that one who may see these resources may read.

    Whoever may see the whole lab reads all. Of anybody else, those that name nothing of the lab,
    and those of which they may see everything that is named.
    """
    rows = list(workflows_of(lab))
    if resource_selectors.root_of(lab).id in seen:
        return rows
    named = {row.pk: resource_selectors.names_in(_values(row.draft)) for row in rows}
    return [row for row in rows if seen and {UUID(one) for one in named[row.pk]} <= set(seen)]


def find_visible(workflow_id: UUID, user: User) -> Workflow:
    """Return a workflow that a person may read.

    Raises:
        NotFoundError: There is none, or they may not.
    """
    row = find_workflow(workflow_id)
    if not _is_seen(row, user):
        raise NotFoundError(f"no workflow {workflow_id}", code="workflow.not_found")
    return row


def visible_version(version_id: UUID, user: User) -> WorkflowVersion:
    """Return a version of a workflow that a person may read.

    Raises:
        NotFoundError: There is none, or they may not.
    """
    row = find_version(version_id)
    if not _is_seen(row.workflow, user):
        raise NotFoundError(f"no version {version_id}", code="workflow.no_version")
    return row


def _is_seen(row: Workflow, user: User) -> bool:
    seen = resource_selectors.allowed_ids(user, Permission.VIEW)
    if resource_selectors.root_of(row.lab).id in seen:
        return True
    named = resource_selectors.names_in(
        _values(row.draft), *(_values(one.document) for one in row.versions.all())
    )
    return bool(seen) and {UUID(one) for one in named} <= seen


def find_named(lab: Lab, name: str, *, author: User) -> Workflow | None:
    """Return the newest workflow of that name by one person, or None."""
    rows = Workflow.objects.filter(lab=lab, name=name, created_by=author)
    return rows.order_by("-created_at").first()


def find_version(version_id: UUID) -> WorkflowVersion:
    """Return a version.

    Raises:
        NotFoundError: There is none.
    """
    row = _VERSION.first(id=version_id)
    if row is None:
        raise NotFoundError(f"no version {version_id}", code="workflow.no_version")
    return row


_VERSION = Prepared(
    lambda: WorkflowVersion.objects.filter(pk=Given("id", UUIDField())).select_related(
        "workflow__lab", "author"
    )
)


def newest_versions(count: int) -> list[WorkflowVersion]:
    """Return so many versions of any workflow, the newest first."""
    rows = WorkflowVersion.objects.select_related("workflow__lab")
    return list(rows.order_by("-pk")[:count])


def find_numbered(workflow_id: UUID, number: int) -> WorkflowVersion:
    """Return version `number` of a workflow.

    Raises:
        NotFoundError: There is none.
    """
    row = (
        WorkflowVersion.objects.filter(workflow_id=workflow_id, number=number)
        .select_related("author")
        .first()
    )
    if row is None:
        raise NotFoundError(f"no version {number}", code="workflow.no_version")
    return row


@dataclass(frozen=True, slots=True)
class StoredProof:
    """How a document stands to the proof of a recipe that one of its versions carries."""

    version: WorkflowVersion
    """The newest that carries the proof."""

    changes: tuple[Finding, ...]
    """What takes it away; none: the document has it."""


def proof_of(workflow: Workflow, document: Mapping[str, Any]) -> StoredProof | None:
    """Return how a document stands to the proofs of a workflow; None: it has none.

    Args:
        workflow: Which.
        document: A draft of it, perhaps unfinished.
    """
    newest: StoredProof | None = None
    rows = workflow.versions.filter(proved__isnull=False).order_by("-number")
    for row in rows.iterator():
        names = resource_selectors.names_in(_values(row.document), _values(document))
        found = StoredProof(row, tuple(changes_since(row.document, document, names)))
        if not found.changes:
            return found
        newest = newest or found
    return newest


def _values(document: Mapping[str, Any]) -> Iterator[object]:
    """Yield the values of the steps of a document, perhaps a malformed one."""
    steps = document.get("steps")
    for step in steps if isinstance(steps, list) else []:
        params = step.get("params") if isinstance(step, dict) else None
        yield from params.values() if isinstance(params, dict) else ()
