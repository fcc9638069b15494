"""REST of workflows and the palette."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.lists import HISTORY
from labweb.common.requests import body
from labweb.domain.approvals.access_tokens import AccessScope
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.dimensions import DIMENSIONS
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.workflows.unit_operations.step_palette import palette
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources import selectors as resource_selectors
from labweb.workflows import selectors, services
from labweb.workflows.answers import (
    DeviceAction,
    DraftSaved,
    PaletteDevice,
    StepChoice,
    StepPalette,
    UnitTable,
    VersionDetail,
    VersionList,
    VersionRow,
)
from labweb.workflows.models import Workflow, WorkflowVersion


class Steps(Endpoint):
    """What can be put into a workflow."""

    def get(self, request: Request) -> StepPalette:
        """Return unit operations, device actions and the units a person may write."""
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        devices = enrollment_selectors.visible_present(resource_selectors.the_lab(), seen)
        units = {
            name: UnitTable(
                canonical=dimension.canonical,
                suffix=dimension.suffix,
                units=list(dimension.units),
                spellings=dict(dimension.spellings),
            )
            for name, dimension in DIMENSIONS.items()
        }
        return StepPalette(
            steps=msgspec.convert(palette(), list[StepChoice]),
            devices=[
                PaletteDevice(
                    id=row.id,
                    name=row.name,
                    role=row.driver.role,
                    roles=list(spec.roles),
                    state=row.state,
                    actions=device_actions(spec),
                )
                for row in devices
                for spec in [enrollment_selectors.spec_of(row)]
            ],
            units=units,
        )


def device_actions(spec: DriverSpec) -> list[DeviceAction]:
    """Return what a device does, each with the schema of its arguments."""
    return [
        DeviceAction(
            name=action.name,
            label=action.name.replace("_", " ").capitalize(),
            doc=action.doc,
            schema=action.schema(),
            hazards=list(action.hazards),
            recovery=action.recovery,
        )
        for action in spec.actions
    ]


class NewWorkflow(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a create."""

    name: str
    document: dict[str, Any] | None = None
    copy_of: UUID | None = None


class Draft(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a save."""

    document: dict[str, Any]
    revision: int


class NewVersion(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a version."""

    note: str = ""
    revision: int | None = None
    """Of the draft that the caller saw; without it the present draft is frozen."""


class Drafts(Endpoint):
    """The draft of one workflow."""

    scopes: ClassVar[Mapping[str, AccessScope]] = {"put": AccessScope.DRAFT}
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"put": Draft}

    def put(self, request: Request, workflow_id: UUID) -> DraftSaved:
        """Save the draft over the revision the caller saw."""
        user, draft = user_of(request), body(request, Draft)
        selectors.find_visible(workflow_id, user)
        row = services.save_draft(
            workflow_id,
            document=draft.document,
            revision=draft.revision,
            actor=user,
        )
        return DraftSaved(revision=row.draft_revision)


class Versions(Endpoint):
    """Versions of one workflow."""

    scopes: ClassVar[Mapping[str, AccessScope]] = {"post": AccessScope.DRAFT}
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": NewVersion}
    queries = HISTORY.parameters
    statuses: ClassVar[dict[str, int]] = {"post": 201}

    def get(self, request: Request, workflow_id: UUID) -> VersionList:
        """List versions without their documents, the newest first."""
        rows = selectors.versions_of(selectors.find_visible(workflow_id, user_of(request)))
        found, following = HISTORY.of_rows(request, rows, "-number")
        return VersionList(versions=[version_row(row) for row in found], next=following)

    def post(self, request: Request, workflow_id: UUID) -> VersionRow:
        """Freeze the draft as a version."""
        user, wanted = user_of(request), body(request, NewVersion)
        selectors.find_visible(workflow_id, user)
        version = services.save_version(
            workflow_id, note=wanted.note, revision=wanted.revision, actor=user
        )
        return version_row(version)


class OneVersion(Endpoint):
    """One version."""

    def get(self, request: Request, workflow_id: UUID, number: int) -> VersionDetail:
        """Return a version with its document."""
        workflow = selectors.find_visible(workflow_id, user_of(request))
        version = selectors.find_numbered(workflow.id, number)
        return VersionDetail(
            **msgspec.structs.asdict(version_row(version)), document=version.document
        )


def create(request: Request) -> Workflow:
    """Create a workflow from a request: empty, from a document, or as a copy."""
    wanted = body(request, NewWorkflow)
    document = wanted.document
    if wanted.copy_of is not None:
        document = selectors.find_visible(wanted.copy_of, user_of(request)).draft
    return services.create_workflow(
        resource_selectors.the_lab(),
        name=wanted.name,
        document=document,
        actor=user_of(request),
    )


def version_row(row: WorkflowVersion) -> VersionRow:
    """Tell of a version without its document."""
    return VersionRow(
        id=row.id,
        number=row.number,
        note=row.note,
        author=None if row.author is None else row.author.printed_name,
        at=row.at,
    )
