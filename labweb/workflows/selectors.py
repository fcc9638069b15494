"""Reads of workflows and versions."""

from __future__ import annotations

from uuid import UUID

from django.db.models import Prefetch, QuerySet, UUIDField

from labweb.accounts.selectors import User
from labweb.common.prepared import Given, Prepared
from labweb.domain.errors import NotFoundError
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


def find_workflow(workflow_id: UUID) -> Workflow:
    """Return a workflow.

    Raises:
        NotFoundError: There is none.
    """
    row = Workflow.objects.filter(pk=workflow_id).select_related("lab", "created_by").first()
    if row is None:
        raise NotFoundError(f"no workflow {workflow_id}", code="workflow.not_found")
    return row


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
