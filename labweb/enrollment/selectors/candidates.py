"""Reads of what hosts see on their networks and ports."""

from __future__ import annotations

import base64
from datetime import datetime, timedelta
from uuid import UUID

from django.db.models import QuerySet

from labweb.common.clock import now
from labweb.common.signatures import authority
from labweb.domain.enrollment.announcement_trust import is_same_everywhere
from labweb.domain.enrollment.device_announcements import FORGOTTEN_AFTER_S
from labweb.domain.enrollment.host_join import code_of
from labweb.domain.errors import NotFoundError
from labweb.enrollment.models import (
    Candidate,
    EdgeHost,
)
from labweb.resources.selectors import Lab


def candidates_of(lab: Lab) -> QuerySet[Candidate]:
    """What hosts have seen, the latest first."""
    related = ("host", "device", "key_changed_from__device")
    return Candidate.objects.filter(lab=lab).select_related(*related)


def new_candidates(lab: Lab) -> list[Candidate]:
    """Return what was seen within a day and nobody has looked at, the latest first."""
    since = now() - timedelta(seconds=FORGOTTEN_AFTER_S)
    return list(candidates_of(lab).filter(state=Candidate.State.NEW, last_seen_at__gt=since))


def find_candidate(candidate_id: UUID) -> Candidate:
    """Return a candidate.

    Raises:
        NotFoundError: There is none.
    """
    rows = Candidate.objects.select_related("lab", "host", "device", "key_changed_from__device")
    row = rows.filter(pk=candidate_id).first()
    if row is None:
        raise NotFoundError(f"no candidate {candidate_id}", code="candidate.not_found")
    return row


def shared_mark(row: Candidate) -> str:
    """Return the mark by which other hosts see the same thing; "": here it may be another."""
    is_shared = is_same_everywhere(
        public_key=row.public_key, model=row.model, serial=row.serial, address=row.address
    )
    return row.mark if is_shared else ""


def rejection_of(lab_id: UUID, mark: str) -> Candidate | None:
    """Return where in a lab the same thing was rejected last; None: nowhere, or no mark."""
    if not mark:
        return None
    rows = Candidate.objects.filter(lab=lab_id, mark=mark, state=Candidate.State.REJECTED)
    return rows.select_related("host", "decided_by").order_by("-decided_at").first()


def known_heard_at(known: Candidate, host: EdgeHost) -> datetime:
    """Return when a host heard the key of what was admitted last; else when it was heard at all."""
    rows = Candidate.objects.filter(host=host, public_key=known.public_key)
    row = rows.order_by("-last_seen_at").first()
    return (row or known).last_seen_at


def is_forgotten(row: Candidate) -> bool:
    """Tell whether a candidate has not been seen for a day."""
    return row.last_seen_at + timedelta(seconds=FORGOTTEN_AFTER_S) <= now()


def code_of_candidate(row: Candidate) -> str:
    """Return the code that the device shows; "" when it has no key."""
    if not row.public_key:
        return ""
    return code_of(authority.authority_hash(), base64.b64decode(row.public_key))
