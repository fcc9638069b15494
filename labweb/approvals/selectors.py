"""Reads of policies, requests and decisions."""

from __future__ import annotations

from uuid import UUID

from django.db.models import QuerySet

from labweb.approvals.models import ApprovalRequest as ApprovalRequest
from labweb.approvals.models import Policy
from labweb.common.clock import now
from labweb.domain.errors import NotFoundError
from labweb.resources.selectors import Lab


def active_policies(lab: Lab) -> QuerySet[Policy]:
    """Policies that are in force."""
    return Policy.objects.filter(lab=lab, is_active=True).order_by("name")


def requests_of(lab: Lab) -> QuerySet[ApprovalRequest]:
    """Requests, newest first, with askers and decisions."""
    return ApprovalRequest.objects.filter(lab=lab).select_related("asked_by", "decision__actor")


def find_request(request_id: UUID) -> ApprovalRequest:
    """Return a request.

    Raises:
        NotFoundError: There is none.
    """
    row = (
        ApprovalRequest.objects.filter(pk=request_id)
        .select_related("asked_by", "decision__actor", "lab")
        .first()
    )
    if row is None:
        raise NotFoundError(f"no request {request_id}", code="approval.not_found")
    return row


def run_of(row: ApprovalRequest) -> UUID:
    """Return the run that a request is about.

    Raises:
        NotFoundError: It is about a driver, and answered on its page.
    """
    if row.run_id is None:
        raise NotFoundError(f"{row.title} is about no run", code="approval.not_found")
    return row.run_id


def request_about_driver(driver_id: UUID) -> ApprovalRequest:
    """Return the newest request about a driver version.

    Raises:
        NotFoundError: Nobody was asked about it.
    """
    row = newest_about_driver(driver_id)
    if row is None:
        raise NotFoundError(f"nobody was asked about {driver_id}", code="approval.not_found")
    return row


def newest_about_driver(driver_id: UUID) -> ApprovalRequest | None:
    """Return the newest request about a driver version with its decision, if it has one."""
    rows = ApprovalRequest.objects.filter(driver_id=driver_id).select_related("decision")
    return rows.order_by("-asked_at").first()


def open_about_drivers(lab: Lab) -> QuerySet[ApprovalRequest]:
    """Open requests about driver versions that can still be answered, with who asked."""
    rows = ApprovalRequest.objects.filter(lab=lab, state="open", driver_id__isnull=False)
    rows = rows.filter(expires_at__gt=now())
    return rows.select_related("asked_by").order_by("asked_at")


def request_of(run_id: UUID) -> ApprovalRequest | None:
    """Return the newest request of a run, if it has one."""
    return ApprovalRequest.objects.filter(run_id=run_id).order_by("-asked_at").first()
