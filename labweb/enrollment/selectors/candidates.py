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
from labweb.enrollment.models import Candidate as Candidate
from labweb.enrollment.models import Device as Device
from labweb.enrollment.models import DriverVersion as DriverVersion
from labweb.enrollment.models import EdgeHost as EdgeHost
from labweb.enrollment.models import Fence as Fence
from labweb.enrollment.models import HostCertificate as HostCertificate
from labweb.enrollment.models import JoinRequest as JoinRequest
from labweb.enrollment.models import JoinToken as JoinToken
from labweb.enrollment.models import Look as Look
from labweb.enrollment.selectors.device_looks import checks_of as checks_of
from labweb.enrollment.selectors.device_looks import is_looking as is_looking
from labweb.enrollment.selectors.device_looks import last_look as last_look
from labweb.enrollment.selectors.device_looks import told_of as told_of
from labweb.enrollment.selectors.device_retirement import is_first_review as is_first_review
from labweb.enrollment.selectors.device_retirement import nodes_of_others as nodes_of_others
from labweb.enrollment.selectors.device_retirement import present_devices as present_devices
from labweb.enrollment.selectors.driver_versions import approved_drivers as approved_drivers
from labweb.enrollment.selectors.driver_versions import driver_for_update as driver_for_update
from labweb.enrollment.selectors.driver_versions import driver_names as driver_names
from labweb.enrollment.selectors.driver_versions import drivers as drivers
from labweb.enrollment.selectors.driver_versions import find_driver as find_driver
from labweb.enrollment.selectors.host_disks import disk_of as disk_of
from labweb.enrollment.selectors.host_disks import disks_of as disks_of
from labweb.enrollment.selectors.join_requests import code_of_request as code_of_request
from labweb.enrollment.selectors.join_requests import find_request as find_request
from labweb.enrollment.selectors.join_requests import is_key_known as is_key_known
from labweb.enrollment.selectors.join_requests import is_stale as is_stale
from labweb.enrollment.selectors.join_requests import request_for_update as request_for_update
from labweb.enrollment.selectors.join_requests import requests_of as requests_of
from labweb.enrollment.selectors.join_requests import token_for_update as token_for_update
from labweb.enrollment.selectors.join_requests import token_state as token_state
from labweb.enrollment.selectors.join_requests import tokens_of as tokens_of
from labweb.enrollment.selectors.join_requests import waiting_requests as waiting_requests
from labweb.enrollment.selectors.returning_devices import (
    changes_since_admission as changes_since_admission,
)
from labweb.enrollment.selectors.returning_devices import kept_review as kept_review
from labweb.enrollment.selectors.returning_devices import label_of as label_of
from labweb.enrollment.selectors.returning_devices import places_of as places_of
from labweb.enrollment.selectors.returning_devices import present_of as present_of
from labweb.enrollment.selectors.returning_devices import taken_from as taken_from
from labweb.enrollment.selectors.visible import find_device as find_device
from labweb.enrollment.selectors.visible import is_seen as is_seen
from labweb.enrollment.selectors.visible import visible_device as visible_device
from labweb.enrollment.selectors.visible import visible_devices as visible_devices
from labweb.enrollment.selectors.visible import visible_host as visible_host
from labweb.enrollment.selectors.visible import visible_hosts as visible_hosts
from labweb.enrollment.selectors.visible import visible_present as visible_present
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
