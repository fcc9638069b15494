"""Reads of hosts, devices and drivers."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from uuid import UUID

import msgspec
from django.db.models import QuerySet

from labweb.domain.enrollment.device import Device as DeviceData
from labweb.domain.enrollment.spec import DriverSpec
from labweb.domain.errors import NotFoundError
from labweb.domain.messages import DeviceConfig
from labweb.domain.runs.session import SessionState
from labweb.enrollment.models import Device as Device
from labweb.enrollment.models import DriverVersion
from labweb.enrollment.models import EdgeHost as EdgeHost
from labweb.enrollment.models import Fence as Fence
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


def hosts_of(lab: Lab) -> QuerySet[EdgeHost]:
    """Edge hosts of a lab."""
    return EdgeHost.objects.filter(lab=lab).order_by("key")


def find_host(host_id: UUID) -> EdgeHost | None:
    """Return a host, or None."""
    return EdgeHost.objects.filter(pk=host_id).select_related("lab").first()


def host_for_update(host_id: UUID) -> EdgeHost:
    """Lock and return a host.

    Raises:
        NotFoundError: There is none.
    """
    rows = EdgeHost.objects.filter(pk=host_id).select_for_update(of=("self",), no_key=True)
    row = rows.first()
    if row is None:
        raise NotFoundError(f"no host {host_id}", code="host.not_found")
    return row


def open_fence(host: EdgeHost) -> Fence | None:
    """Return the fence of a host that waits for its second signature, or None."""
    rows = Fence.objects.filter(host=host, second_at__isnull=True, withdrawn_at__isnull=True)
    return rows.select_related("first_by").first()


def all_hosts() -> QuerySet[EdgeHost]:
    """Every host of every lab."""
    return EdgeHost.objects.all()


def session_states() -> dict[UUID, SessionState]:
    """Return how the server sees every host."""
    return {
        host_id: SessionState(state)
        for host_id, state in EdgeHost.objects.values_list("id", "state")
    }


def hosts_online() -> QuerySet[EdgeHost]:
    """The hosts that may get new work."""
    return EdgeHost.objects.filter(state="online")


def devices_of(lab: Lab) -> QuerySet[Device]:
    """Devices of a lab with host and driver."""
    return Device.objects.filter(lab=lab).select_related("host", "driver")


def enrolled_devices(lab: Lab) -> QuerySet[Device]:
    """Devices that were admitted."""
    return devices_of(lab).filter(state=Device.State.ENROLLED)


def find_device(device_id: UUID) -> Device:
    """Return a device with host and driver.

    Raises:
        NotFoundError: There is none.
    """
    row = Device.objects.filter(pk=device_id).select_related("host", "driver", "lab").first()
    if row is None:
        raise NotFoundError(f"no device {device_id}", code="device.not_found")
    return row


def device_for_update(device_id: UUID) -> Device:
    """Lock and return a device.

    Raises:
        NotFoundError: There is none.
    """
    row = Device.objects.filter(pk=device_id).select_for_update(of=("self",)).first()
    if row is None:
        raise NotFoundError(f"no device {device_id}", code="device.not_found")
    return row


def node_ids(row: Device) -> set[UUID]:
    """Return the resources a device acts through; the lab's root when it acts through none."""
    return {UUID(node) for node in row.nodes.values()} or {resource_selectors.root_of(row.lab).id}


def visible_devices(lab: Lab, seen: Collection[UUID]) -> list[Device]:
    """Return the devices that act through at least one of the resources."""
    return [row for row in devices_of(lab) if is_seen(row, seen)]


def is_seen(row: Device, seen: Collection[UUID]) -> bool:
    """Tell whether a device acts through one of the resources; without nodes it is no secret."""
    return any(UUID(node) in seen for node in row.nodes.values()) or not row.nodes


def spec_of(row: Device) -> DriverSpec:
    """Return the driver's published interface."""
    return msgspec.convert(row.driver.spec, DriverSpec)


def to_domain(row: Device) -> DeviceData:
    """Turn a row into what planning works on."""
    return DeviceData(
        id=row.id,
        key=row.key,
        name=row.name,
        host_id=row.host_id,
        spec=spec_of(row),
        transport=row.transport,
        config=row.config,
        nodes={role: UUID(node) for role, node in row.nodes.items()},
    )


def config_for_host(row: Device) -> DeviceConfig:
    """Return what the host needs to serve the device."""
    spec = spec_of(row)
    return DeviceConfig(
        id=row.id,
        key=row.key,
        name=row.name,
        module=row.driver.module,
        class_name=row.driver.class_name,
        digest=row.driver.digest,
        transport=row.transport,
        config=row.config,
        statuses={status.name: status.every_s or 1.0 for status in spec.statuses},
        nodes={role: UUID(node) for role, node in row.nodes.items()},
    )


def driver_names(digests: Iterable[str]) -> dict[str, str]:
    """Return the class of each driver version by the digest of its source."""
    rows = DriverVersion.objects.filter(digest__in=list(digests))
    return {row.digest: f"{row.module}:{row.class_name}" for row in rows}
