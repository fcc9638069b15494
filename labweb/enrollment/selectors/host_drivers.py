"""Reads of the driver sources that a host may fetch."""

from __future__ import annotations

from uuid import UUID

from django.db.models import Q

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


def driver_for_host(host_id: UUID, digest: str) -> DriverVersion | None:
    """Return an approved version that a device of the host uses, or is to; None: there is none."""
    rows = Device.objects.filter(host_id=host_id, state=Device.State.ENROLLED)
    used = rows.filter(Q(driver__digest=digest) | Q(next_driver__digest=digest))
    if not used.exists():
        return None
    state = DriverVersion.State.APPROVED
    return DriverVersion.objects.filter(digest=digest, state=state).first()
