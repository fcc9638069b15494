"""Writes of drivers that a second person approves: submitted, decided, withdrawn."""

from __future__ import annotations

from datetime import timedelta
from functools import partial
from uuid import UUID

from django.db.transaction import atomic, on_commit

from labweb.accounts.selectors import User
from labweb.approvals import selectors
from labweb.approvals.models import ApprovalRequest
from labweb.approvals.services.approval_requests import decide, require_deciding
from labweb.common import feed
from labweb.common.clock import now
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import DriverVersion
from labweb.enrollment.services import CatalogDriver
from labweb.resources import selectors as resource_selectors

DRIVER_RULE = "A driver needs a second person"


_DRIVER_REQUEST_LIFE = timedelta(days=30)


def submit_driver(module: str, text: str, *, note: str, actor: User) -> DriverVersion:
    """Keep driver source that a person brought, and ask a second person about it.

    Raises:
        ForbiddenError: The actor may not bring drivers.
        ConformanceError: It breaks a rule; `findings` list each place. Nothing was written.
        DefinitionError: With what it shares it is too large.
        StateError: This very source is known already.
    """
    found, _ = enrollment_services.read_driver(module, text, actor=actor)
    return submit_read(found, module, note=note, actor=actor)


@atomic
def submit_read(found: CatalogDriver, module: str, *, note: str, actor: User) -> DriverVersion:
    """Keep driver source that was read for the actor, and ask a second person about it.

    Args:
        found: What `enrollment.services.read_driver` returned for the actor. Another process
            takes seconds to read it, and no transaction is to be open meanwhile.
        module: Where the driver is to stand.
        note: What the actor says of it.
        actor: Who brings it.

    Raises:
        DefinitionError: With what it shares it is too large.
        StateError: This very source is known already.
    """
    row = enrollment_services.propose_driver(found, module, note=note, actor=actor)
    _close_requests(row, ApprovalRequest.State.EXPIRED)
    request = ApprovalRequest.objects.create(
        lab=resource_selectors.the_lab(),
        title=f"Driver {row.class_name} of {row.module}, {row.digest[:12]}",
        driver_id=row.id,
        plan_digest=row.digest,
        policies=[DRIVER_RULE],
        allow_self=False,
        asked_by=actor,
        asked_at=now(),
        expires_at=now() + _DRIVER_REQUEST_LIFE,
    )
    on_commit(partial(feed.publish, "approvals", {"request_id": str(request.id)}))
    return row


@atomic
def decide_driver(
    version_id: UUID, *, actor: User, is_approved: bool, comment: str
) -> DriverVersion:
    """Approve or reject a driver version; an approval signs the digest of its source.

    Raises:
        NotFoundError: There is no such version, or nobody was asked about it.
        ForbiddenError: The actor brought it, or may not decide here.
        StateError: Somebody answered before, or the request has expired.

    Effect:
        None on matter. Devices get the version only when somebody gives it to them.
    """
    require_deciding(actor, resource_selectors.the_lab())
    enrollment_selectors.driver_for_update(version_id)  # first, as whoever withdraws it does
    request = selectors.request_about_driver(version_id)
    decide(request.id, actor=actor, is_approved=is_approved, comment=comment)
    return enrollment_services.settle_proposal(
        version_id, actor=actor, is_approved=is_approved, comment=comment
    )


@atomic
def withdraw_driver(version_id: UUID, *, actor: User, reason: str) -> DriverVersion:
    """Let a driver version be used no more, and ask about it no more.

    Raises:
        LabError: As `labweb.enrollment.services.withdraw_driver`.
    """
    row = enrollment_services.withdraw_driver(version_id, actor=actor, reason=reason)
    _close_requests(row, ApprovalRequest.State.WITHDRAWN)
    return row


def _close_requests(row: DriverVersion, state: ApprovalRequest.State) -> None:
    rows = ApprovalRequest.objects.filter(driver_id=row.id, state=ApprovalRequest.State.OPEN)
    rows.update(state=state)
