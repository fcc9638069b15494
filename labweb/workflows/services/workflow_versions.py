"""Writes of workflows: drafts, versions, templates."""

from __future__ import annotations

import hashlib
from functools import partial
from typing import Any
from uuid import UUID

from django.db.models import Max
from django.db.transaction import atomic, on_commit

from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import now
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.canonical_json import canonical
from labweb.domain.errors import (
    DefinitionError,
    ForbiddenError,
    ProtocolError,
    RevisionError,
)
from labweb.domain.workflows.workflow_draft import check_draft
from labweb.domain.workflows.workflow_file import parse_workflow
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.workflows import selectors
from labweb.workflows.models import Workflow, WorkflowVersion

SCHEMA = "labweb.workflow/1"
MAX_DRAFT_BYTES = 1024 * 1024
LONGEST_NAME = 200


def require_drawing(lab: Lab, actor: User) -> None:
    """Refuse who may not draw on the whole lab, to which every workflow belongs.

    Raises:
        ForbiddenError: They may not, or only in a part of the lab; it says who can help.
    """
    root = resource_selectors.root_of(lab).id
    allowed = resource_selectors.allowed_ids(actor, Permission.DRAW)
    if root not in allowed:
        told = "only in a part of the lab" if allowed else "nowhere in the lab"
        raise ForbiddenError(
            f"a workflow belongs to the whole lab, and {actor.username} may draw {told}. Ask an "
            "admin for the role of chemist on the whole lab, or somebody who has it to draw this",
            context={"permission": Permission.DRAW.value, "resources": [str(root)]},
        )


def _check_name(name: str) -> None:
    """Refuse a name that does not read as it is written."""
    if not name.isprintable():
        raise DefinitionError(
            "the name of a workflow holds a character that cannot be seen, such as a line break"
            " or one that turns the direction of writing",
            code="workflow.name",
        )


def _check_revision(row: Workflow, revision: int) -> None:
    if row.draft_revision != revision:
        raise RevisionError(
            "somebody saved this draft in between",
            code="workflow.revision",
            context={"revision": row.draft_revision, "document": row.draft},
        )


def _check_document(document: dict[str, Any]) -> None:
    """Refuse a document that no page could open, or that is too large to keep."""
    findings = check_draft(document)
    if findings:
        count = len(findings)
        more = f", and {count - 1} more" if count > 1 else ""
        raise ProtocolError(
            f"the draft cannot be kept: {findings[0].message}{more}",
            code=findings[0].code,
            findings=findings,
        )
    if len(canonical(document)) > MAX_DRAFT_BYTES:
        raise DefinitionError("a workflow may have 1 MB", code="workflow.too_large")


@atomic
def create_workflow(
    lab: Lab, *, name: str, document: dict[str, Any] | None, actor: User
) -> Workflow:
    """Create a workflow with a draft; drafts may be unfinished.

    Raises:
        DefinitionError: The name is empty, too long or not printable, or the document too large.
        ProtocolError: No page could open the document; `findings` have the path of each place.
        ForbiddenError: The actor may not draw here.
    """
    require_drawing(lab, actor)
    clean = name.strip()
    if not clean or len(clean) > LONGEST_NAME:
        raise DefinitionError(
            "a workflow needs a name of 1 to 200 characters", code="workflow.name"
        )
    _check_name(clean)
    draft = (
        document
        if document is not None
        else {"schema": SCHEMA, "name": clean, "steps": [], "edges": []}
    )
    _check_document(draft)
    at = now()
    row = Workflow.objects.create(
        lab=lab,
        name=clean,
        draft={**draft, "name": clean},
        created_by=actor,
        created_at=at,
        updated_at=at,
    )
    on_commit(partial(feed.publish, "workflows", {"workflow_id": str(row.id)}))
    return row


@atomic
def save_draft(
    workflow_id: UUID, *, document: dict[str, Any], revision: int, actor: User
) -> Workflow:
    """Save a draft over the revision the author saw.

    Raises:
        RevisionError: Somebody saved in between; `context` carries the newer draft.
        DefinitionError: The document is too large, or its name is not printable.
        ProtocolError: No page could open the document; `findings` have the path of each place.
    """
    row = Workflow.objects.select_for_update(no_key=True).get(
        pk=selectors.find_workflow(workflow_id).pk
    )
    require_drawing(row.lab, actor)
    _check_document(document)
    _check_revision(row, revision)
    name = document.get("name")
    if isinstance(name, str):
        _check_name(name)
    row.draft = document
    if isinstance(name, str) and 0 < len(name.strip()) <= LONGEST_NAME:
        row.name = name.strip()
    row.draft_revision += 1
    row.updated_at = now()
    row.save()
    on_commit(partial(feed.publish, "workflows", {"workflow_id": str(row.id)}))
    return row


@atomic
def save_version(
    workflow_id: UUID,
    *,
    note: str,
    actor: User | None,
    revision: int | None = None,
    proved: dict[str, Any] | None = None,
) -> WorkflowVersion:
    """Freeze the draft as the next version; the same draft twice is one version.

    `revision` is of the draft that the author saw; None freezes whichever is there. `proved` is
    what a proof takes for granted; None: that of the last version that does the same, if any.

    Raises:
        RevisionError: Somebody saved in between; `context` carries the newer draft.
        ProtocolError: The draft is malformed; findings list each place.
    """
    row = Workflow.objects.select_for_update(no_key=True).get(
        pk=selectors.find_workflow(workflow_id).pk
    )
    if actor is not None:
        require_drawing(row.lab, actor)
    if revision is not None:
        _check_revision(row, revision)
    parse_workflow(row.draft)
    digest = hashlib.sha256(canonical(row.draft)).hexdigest()
    if proved is None:
        same = selectors.proof_of(row, row.draft)
        proved = None if same is None or same.changes else same.version.proved
    last = row.versions.order_by("-number").first()
    if last is not None and last.digest == digest and last.proved == proved:
        return last
    number = (row.versions.aggregate(Max("number"))["number__max"] or 0) + 1
    return WorkflowVersion.objects.create(
        workflow=row,
        number=number,
        document=row.draft,
        digest=digest,
        note=note[:300],
        proved=proved,
        author=actor,
        at=now(),
    )


@atomic
def ensure_template(lab: Lab, *, document: dict[str, Any], author: User | None) -> Workflow:
    """Write a template with its version 1 unless one of that name exists."""
    found = Workflow.objects.filter(lab=lab, is_template=True, name=document["name"]).first()
    if found is not None:
        return found
    at = now()
    row = Workflow.objects.create(
        lab=lab,
        name=document["name"],
        is_template=True,
        draft=document,
        created_by=author,
        created_at=at,
        updated_at=at,
    )
    save_version(row.id, note="template", actor=None)
    return row
