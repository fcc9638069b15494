"""Devices and hosts that a person may see; one that they may not is as one that there is not."""

from __future__ import annotations

from collections.abc import Collection
from uuid import UUID

from django.db.models import UUIDField

from labweb.accounts.selectors import User
from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import NotFoundError
from labweb.enrollment.models import Device, EdgeHost
from labweb.enrollment.selectors.device_retirement import present_devices
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


def is_seen(row: Device, seen: Collection[UUID]) -> bool:
    """Tell whether a device acts through one of the resources; without nodes it is no secret."""
    return any(UUID(node) in seen for node in row.nodes.values()) or not row.nodes


def visible_devices(lab: Lab, seen: Collection[UUID]) -> list[Device]:
    """Return the devices that act through at least one of the resources, retired ones too."""
    rows = Device.objects.filter(lab=lab).select_related("host", "driver", "next_driver")
    return [row for row in rows if is_seen(row, seen)]


def visible_present(lab: Lab, seen: Collection[UUID]) -> list[Device]:
    """Return those of them that are not retired."""
    return [row for row in present_devices(lab) if is_seen(row, seen)]


def find_device(device_id: UUID, seen: Collection[UUID] | None = None) -> Device:
    """Return a device with host and driver.

    Args:
        device_id: Which.
        seen: The resources that the asker may see; None: the server itself asks.

    Raises:
        NotFoundError: There is none, or they may not see it.
    """
    row = _DEVICE.first(id=device_id)
    if row is None or not (seen is None or is_seen(row, seen)):
        raise NotFoundError(f"no device {device_id}", code="device.not_found")
    return row


_DEVICE = Prepared(
    lambda: Device.objects.filter(pk=Given("id", UUIDField())).select_related(
        "host", "driver", "next_driver", "lab"
    )
)


def visible_device(device_id: UUID, user: User) -> Device:
    """Return a device that the user may see; raises as `find_device`."""
    return find_device(device_id, resource_selectors.allowed_ids(user, Permission.VIEW))


def visible_hosts(lab: Lab, user: User) -> list[EdgeHost]:
    """Return the hosts that own a device the user may see; all to who sees the whole lab."""
    seen = resource_selectors.allowed_ids(user, Permission.VIEW)
    hosts = EdgeHost.objects.filter(lab=lab).order_by("key")
    if resource_selectors.root_of(lab).id in seen:
        return list(hosts)
    owners = {row.host_id for row in visible_devices(lab, seen)}
    return [host for host in hosts if host.id in owners]


def visible_host(lab: Lab, host_id: UUID, user: User) -> EdgeHost:
    """Return one of these.

    Raises:
        NotFoundError: There is none, or the user may not see it.
    """
    row = next((one for one in visible_hosts(lab, user) if one.id == host_id), None)
    if row is None:
        raise NotFoundError(f"no host {host_id}", code="host.not_found")
    return row
