"""Reads of hosts, devices and drivers."""

from __future__ import annotations

import base64
from collections.abc import Collection, Iterable
from datetime import datetime, timedelta
from uuid import UUID

import msgspec
from django.db.models import Q, QuerySet, UUIDField

from labweb.common.clock import now
from labweb.common.database.prepared_queries import Given, Prepared
from labweb.common.signatures import authority
from labweb.domain.enrollment.admission import admitted_spec
from labweb.domain.enrollment.claims import is_same_everywhere
from labweb.domain.enrollment.device import Device as DeviceData
from labweb.domain.enrollment.join import code_of
from labweb.domain.enrollment.sighting import FORGOTTEN_AFTER_S
from labweb.domain.enrollment.spec import DriverSpec
from labweb.domain.errors import NotFoundError
from labweb.domain.messages import DeviceConfig, StopLab
from labweb.domain.runs.session import SessionState
from labweb.enrollment.models import Candidate as Candidate
from labweb.enrollment.models import Device as Device
from labweb.enrollment.models import DriverVersion as DriverVersion
from labweb.enrollment.models import EdgeHost as EdgeHost
from labweb.enrollment.models import Fence as Fence
from labweb.enrollment.models import HostCertificate as HostCertificate
from labweb.enrollment.models import JoinRequest as JoinRequest
from labweb.enrollment.models import JoinToken as JoinToken
from labweb.enrollment.models import Look as Look
from labweb.enrollment.selectors.disks import disk_of as disk_of
from labweb.enrollment.selectors.disks import disks_of as disks_of
from labweb.enrollment.selectors.joining import code_of_request as code_of_request
from labweb.enrollment.selectors.joining import find_request as find_request
from labweb.enrollment.selectors.joining import is_key_known as is_key_known
from labweb.enrollment.selectors.joining import is_stale as is_stale
from labweb.enrollment.selectors.joining import request_for_update as request_for_update
from labweb.enrollment.selectors.joining import requests_of as requests_of
from labweb.enrollment.selectors.joining import token_for_update as token_for_update
from labweb.enrollment.selectors.joining import token_state as token_state
from labweb.enrollment.selectors.joining import tokens_of as tokens_of
from labweb.enrollment.selectors.joining import waiting_requests as waiting_requests
from labweb.enrollment.selectors.looks import checks_of as checks_of
from labweb.enrollment.selectors.looks import is_looking as is_looking
from labweb.enrollment.selectors.looks import last_look as last_look
from labweb.enrollment.selectors.looks import told_of as told_of
from labweb.enrollment.selectors.retiring import is_first_review as is_first_review
from labweb.enrollment.selectors.retiring import nodes_of_others as nodes_of_others
from labweb.enrollment.selectors.retiring import present_devices as present_devices
from labweb.enrollment.selectors.returning import (
    changes_since_admission as changes_since_admission,
)
from labweb.enrollment.selectors.returning import kept_review as kept_review
from labweb.enrollment.selectors.returning import label_of as label_of
from labweb.enrollment.selectors.returning import places_of as places_of
from labweb.enrollment.selectors.returning import present_of as present_of
from labweb.enrollment.selectors.returning import taken_from as taken_from
from labweb.enrollment.selectors.seen import find_device as find_device
from labweb.enrollment.selectors.seen import is_seen as is_seen
from labweb.enrollment.selectors.seen import visible_device as visible_device
from labweb.enrollment.selectors.seen import visible_devices as visible_devices
from labweb.enrollment.selectors.seen import visible_host as visible_host
from labweb.enrollment.selectors.seen import visible_hosts as visible_hosts
from labweb.enrollment.selectors.seen import visible_present as visible_present
from labweb.enrollment.selectors.versions import approved_drivers as approved_drivers
from labweb.enrollment.selectors.versions import driver_for_update as driver_for_update
from labweb.enrollment.selectors.versions import driver_names as driver_names
from labweb.enrollment.selectors.versions import drivers as drivers
from labweb.enrollment.selectors.versions import find_driver as find_driver
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


def hosts_of(lab: Lab) -> QuerySet[EdgeHost]:
    """Edge hosts of a lab."""
    return EdgeHost.objects.filter(lab=lab).order_by("key")


def find_host(host_id: UUID) -> EdgeHost | None:
    """Return a host, or None."""
    return EdgeHost.objects.filter(pk=host_id).select_related("lab").first()


def open_stop(host_id: UUID) -> StopLab | None:
    """Return the stop of its lab that a host has not acknowledged, or None."""
    host = find_host(host_id)
    if host is None or not host.lab.is_stopped or host.lab.stop_id is None:
        return None
    if host.stop_acknowledged == host.lab.stop_id:
        return None
    return StopLab(stop_id=host.lab.stop_id, issued_by=str(host.lab.stopped_by_id))


def host_for_update(host_id: UUID) -> EdgeHost:
    """Lock and return a host.

    Raises:
        NotFoundError: There is none.
    """
    row = HOST_TO_LOCK.first(id=host_id)
    if row is None:
        raise NotFoundError(f"no host {host_id}", code="host.not_found")
    return row


HOST_TO_LOCK = Prepared(
    lambda: EdgeHost.objects.filter(pk=Given("id", UUIDField())).select_for_update(
        of=("self",), no_key=True
    )
)


def open_fence(host: EdgeHost) -> Fence | None:
    """Return the fence of a host that waits for its second signature, or None."""
    rows = Fence.objects.filter(host=host, second_at__isnull=True, withdrawn_at__isnull=True)
    return rows.select_related("first_by").first()


def all_hosts() -> QuerySet[EdgeHost]:
    """Every host of every lab."""
    return EdgeHost.objects.all()


def session_states() -> dict[UUID, SessionState]:
    """Return how the server sees every host; a suspended one is as good as away."""
    rows = EdgeHost.objects.values_list("id", "state", "suspended_at")
    return {
        host_id: SessionState(state) if suspended_at is None else _by_suspension(state)
        for host_id, state, suspended_at in rows
    }


def _by_suspension(state: str) -> SessionState:
    is_there = state in {SessionState.ONLINE.value, SessionState.SUSPECT.value}
    return SessionState.ISOLATED if is_there else SessionState(state)


def hosts_online() -> QuerySet[EdgeHost]:
    """The hosts that hear what is sent to them."""
    return EdgeHost.objects.filter(state="online")


def hosts_ready() -> QuerySet[EdgeHost]:
    """The hosts that may get new work."""
    return hosts_online().filter(suspended_at__isnull=True)


READY = Prepared(lambda: hosts_ready().values_list("pk", "name", "heartbeat"))
"""The hosts that may get new work: id, name, and what they said last."""


def devices_of(lab: Lab) -> QuerySet[Device]:
    """Devices of a lab with host and drivers."""
    return Device.objects.filter(lab=lab).select_related("host", "driver", "next_driver")


def enrolled_devices(lab: Lab) -> QuerySet[Device]:
    """Devices that were admitted."""
    return devices_of(lab).filter(state=Device.State.ENROLLED)


TO_PLAN = Prepared(
    lambda: (
        Device.objects.filter(lab_id=Given("lab", UUIDField()), state=Device.State.ENROLLED)
        .select_related("driver", "host")
        .defer("driver__spec", "driver__sources")
    )
)
"""The devices of a lab that were admitted, with their hosts, and without what their drivers say of
themselves."""


def devices_by_id(ids: Iterable[UUID]) -> dict[UUID, Device]:
    """Return devices with host and driver, without what their drivers say of themselves."""
    rows = Device.objects.filter(pk__in=list(ids)).select_related("host", "driver")
    return {row.id: row for row in rows.defer("driver__spec", "driver__sources")}


def device_for_update(device_id: UUID) -> Device:
    """Lock and return a device; jobs that name it may come meanwhile, and wait for nothing.

    Raises:
        NotFoundError: There is none.
    """
    row = _DEVICE_TO_LOCK.first(id=device_id)
    if row is None:
        raise NotFoundError(f"no device {device_id}", code="device.not_found")
    return row


_DEVICE_TO_LOCK = Prepared(
    lambda: Device.objects.filter(pk=Given("id", UUIDField())).select_for_update(
        of=("self",), no_key=True
    )
)


def node_ids(row: Device) -> set[UUID]:
    """Return the resources a device acts through; the lab's root when it acts through none."""
    return {UUID(node) for node in row.nodes.values()} or {resource_selectors.root_of(row.lab).id}


def declared_spec(row: Device) -> DriverSpec:
    """Return all that the driver declares."""
    return msgspec.convert(row.driver.spec, DriverSpec)


def specs_of(rows: Collection[Device]) -> dict[UUID, DriverSpec]:
    """Return the drivers' interfaces as far as they were admitted, by device.

    A version is never edited, so each is read once in a process; one query for those that
    were not.
    """
    wanted = {row.driver_id for row in rows}
    missing = wanted.difference(_SPECS)
    if missing and len(_SPECS) + len(missing) > _MOST_SPECS:
        _SPECS.clear()
        missing = wanted
    if missing:
        found = DriverVersion.objects.filter(pk__in=missing).values_list("pk", "spec")
        _SPECS.update((pk, msgspec.convert(spec, DriverSpec)) for pk, spec in found)
    return {row.id: admitted_spec(_SPECS[row.driver_id], row.admission) for row in rows}


_SPECS: dict[UUID, DriverSpec] = {}
_MOST_SPECS = 1000


def spec_of(row: Device) -> DriverSpec:
    """Return the driver's interface as far as it was admitted."""
    return admitted_spec(declared_spec(row), row.admission)


def to_domain(row: Device, spec: DriverSpec) -> DeviceData:
    """Turn a row into what planning works on."""
    return DeviceData(
        id=row.id,
        key=row.key,
        name=row.name,
        host_id=row.host_id,
        spec=spec,
        transport=row.transport,
        config=row.config,
        nodes={role: UUID(node) for role, node in row.nodes.items()},
    )


def config_for_host(row: Device, driver: DriverVersion | None = None) -> DeviceConfig:
    """Return what the host needs to serve the device, with its own driver or with another."""
    driver = driver or row.driver
    spec = msgspec.convert(driver.spec, DriverSpec)
    return DeviceConfig(
        id=row.id,
        key=row.key,
        name=row.name,
        module=driver.module,
        class_name=driver.class_name,
        digest=driver.digest,
        transport=row.transport,
        config=row.config,
        statuses={status.name: status.every_s or 1.0 for status in spec.statuses},
        nodes={role: UUID(node) for role, node in row.nodes.items()},
        admission=row.admission,
        public_key=str(row.admitted_as.get("public_key", "")),
    )


def users_of_driver(row: DriverVersion) -> QuerySet[Device]:
    """Devices that use a version, or are to; retired ones count no more."""
    rows = Device.objects.filter(Q(driver=row) | Q(next_driver=row))
    return rows.exclude(state=Device.State.RETIRED)


def driver_for_host(host_id: UUID, digest: str) -> DriverVersion | None:
    """Return an approved version that a device of the host uses, or is to; None: there is none."""
    rows = Device.objects.filter(host_id=host_id, state=Device.State.ENROLLED)
    used = rows.filter(Q(driver__digest=digest) | Q(next_driver__digest=digest))
    if not used.exists():
        return None
    state = DriverVersion.State.APPROVED
    return DriverVersion.objects.filter(digest=digest, state=state).first()


def staged_devices(host: EdgeHost) -> QuerySet[Device]:
    """Devices of a host that shall have another version of their driver."""
    rows = Device.objects.filter(host=host, state=Device.State.ENROLLED)
    return rows.filter(next_driver__isnull=False).select_related("driver", "next_driver", "lab")


def switching_devices(host: EdgeHost) -> QuerySet[Device]:
    """Devices of a host whose next version may take over once they are idle.

    One that is not admitted is among them: what it did when it was suspended runs to its end.
    """
    rows = Device.objects.filter(host=host, is_next_ready=True, next_driver__isnull=False)
    return rows.select_related("driver", "next_driver", "lab")


def hosts_switching() -> list[UUID]:
    """Return the hosts at which a version may take over that has not done so yet."""
    rows = Device.objects.filter(is_next_ready=True)
    return sorted(set(rows.values_list("host_id", flat=True)))


# --- what hosts see ---


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
