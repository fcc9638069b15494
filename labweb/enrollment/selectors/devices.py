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
from labweb.enrollment.models import (
    Device,
    DriverVersion,
    EdgeHost,
)
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
