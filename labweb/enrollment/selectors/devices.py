"""Reads of devices and their specs."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from uuid import UUID

import msgspec
from django.db.models import Q, QuerySet, UUIDField

from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.enrollment.admitted_device import AdmittedDevice as DeviceData
from labweb.domain.enrollment.admitted_interface import admitted_spec
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.errors import NotFoundError
from labweb.domain.messages.devices_and_drivers import DeviceConfig
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
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


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
