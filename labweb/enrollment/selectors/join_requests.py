"""Reads of machines that ask to become hosts."""

from __future__ import annotations

import base64
from datetime import timedelta
from uuid import UUID

from django.db.models import QuerySet

from labweb.common.clock import now
from labweb.common.signatures import authority
from labweb.domain.enrollment.host_join import WAITS_FOR_S, code_of
from labweb.domain.errors import NotFoundError
from labweb.enrollment.models import Candidate as Candidate
from labweb.enrollment.models import Device as Device
from labweb.enrollment.models import DriverVersion as DriverVersion
from labweb.enrollment.models import EdgeHost as EdgeHost
from labweb.enrollment.models import Fence as Fence
from labweb.enrollment.models import HostCertificate as HostCertificate
from labweb.enrollment.models import JoinRequest as JoinRequest
from labweb.enrollment.models import JoinToken as JoinToken
from labweb.resources.selectors import Lab


def tokens_of(lab: Lab) -> QuerySet[JoinToken]:
    """Join tokens of a lab, the newest first."""
    return JoinToken.objects.filter(lab=lab).select_related("created_by", "request")


def token_for_update(token_id: UUID) -> JoinToken:
    """Lock and return a token.

    Raises:
        NotFoundError: There is none.
    """
    row = JoinToken.objects.filter(pk=token_id).select_for_update(no_key=True).first()
    if row is None:
        raise NotFoundError(f"no token {token_id}", code="join.not_found")
    return row


def token_state(row: JoinToken) -> str:
    """Say in one word how a token stands."""
    if row.used_at is not None:
        return "used"
    if row.withdrawn_at is not None:
        return "withdrawn"
    return "expired" if row.expires_at <= now() else "open"


def requests_of(lab: Lab) -> QuerySet[JoinRequest]:
    """Machines that asked to become hosts, the newest first."""
    rows = JoinRequest.objects.filter(lab=lab)
    return rows.select_related("token__created_by", "known_host", "host", "decided_by")


def waiting_requests(lab: Lab) -> list[JoinRequest]:
    """Return the machines that wait for a person's answer."""
    return [row for row in requests_of(lab).filter(state="waiting") if not is_stale(row)]


def find_request(request_id: UUID) -> JoinRequest:
    """Return the request of a machine.

    Raises:
        NotFoundError: There is none.
    """
    rows = JoinRequest.objects.select_related("lab", "host", "known_host", "decided_by")
    row = rows.filter(pk=request_id).first()
    if row is None:
        raise NotFoundError(f"no request {request_id}", code="join.not_found")
    return row


def request_for_update(request_id: UUID) -> JoinRequest:
    """Lock and return the request of a machine.

    Raises:
        NotFoundError: There is none.
    """
    row = JoinRequest.objects.filter(pk=request_id).select_for_update(no_key=True).first()
    if row is None:
        raise NotFoundError(f"no request {request_id}", code="join.not_found")
    return row


def is_stale(row: JoinRequest) -> bool:
    """Tell whether a machine has waited too long for its request to be answered."""
    is_waiting = row.state == JoinRequest.State.WAITING
    return is_waiting and row.asked_at + timedelta(seconds=WAITS_FOR_S) <= now()


def code_of_request(row: JoinRequest) -> str:
    """Return the code that the machine shows."""
    return code_of(authority.authority_hash(), base64.b64decode(row.public_key))


def is_key_known(public_key: str) -> bool:
    """Tell whether a key is, was, or asked to be a host's."""
    return (
        EdgeHost.objects.filter(public_key=public_key).exists()
        or HostCertificate.objects.filter(public_key=public_key).exists()
        or JoinRequest.objects.filter(public_key=public_key).exists()
    )
