"""Reads of policies, requests and decisions."""

from __future__ import annotations

from uuid import UUID

from django.db.models import QuerySet

from labweb.approvals.models import ApprovalRequest as ApprovalRequest
from labweb.approvals.models import Policy
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


def request_of(run_id: UUID) -> ApprovalRequest | None:
    """Return the newest request of a run, if it has one."""
    return ApprovalRequest.objects.filter(run_id=run_id).order_by("-asked_at").first()
