"""Have a host look at a device that no line serves yet. It reads; nothing moves."""

from __future__ import annotations

from functools import partial
from uuid import UUID

import msgspec
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import now
from labweb.common.signatures import signing
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.enrollment.driver_bundle import PART_BYTES, encode_bundle
from labweb.domain.errors import StateError
from labweb.domain.messages.device_looks import LookOrder, LookPart, LookTold
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.enrollment import selectors
from labweb.enrollment.models import Device, DriverVersion, Look
from labweb.enrollment.services.host_messages import tell_host
from labweb.resources import selectors as resource_selectors

MOST_TOLD_BYTES = 32 * 1024
"""Longest answer of a host that is kept; a longer one counts as none."""


@atomic
def ask_look(device_id: UUID, *, actor: User) -> Look:
    """Have a device's host ask who answers there, and for every status, in a confined process.

    Raises:
        NotFoundError: There is no such device.
        ForbiddenError: The actor may not admit where it stands.
        StateError: It is served, its driver is not approved, its host is away, or a look at it
            is under way.

    Effect:
        None on matter: a look only reads. What it showed stands in the review of the device.
    """
    row = selectors.device_for_update(device_id)
    resource_selectors.require(actor, Permission.ADMIT, selectors.node_ids(row))
    if row.state not in {Device.State.CANDIDATE, Device.State.SUSPENDED}:
        text = f"{row.name} is {row.state}: what it tells stands on its page"
        raise StateError(text, code="look.served")
    version = row.driver
    if version.state != DriverVersion.State.APPROVED or not version.approval:
        raise StateError(f"{version} is {version.state}, not approved", code="driver.not_approved")
    if not selectors.hosts_online().filter(pk=row.host_id, suspended_at=None).exists():
        text = f"{row.host.name} is away or suspended: nobody else reaches {row.name}"
        raise StateError(text, code="look.no_host")
    before = selectors.last_look(row)
    if before is not None and selectors.is_looking(before):
        raise StateError(f"{row.host.name} looks at {row.name} already", code="look.under_way")
    look = Look.objects.create(
        device=row,
        driver=version,
        host=row.host,
        epoch=row.host.epoch,
        transport=row.transport,
        config=row.config,
        asked_by=actor,
        asked_at=now(),
    )
    detail = {"device_id": str(row.id), "digest": version.digest, "transport": row.transport}
    account_services.write_audit("device.look", str(look.id), actor=actor, detail=detail)
    on_commit(partial(tell_host, row.host_id, {"type": "edge.look", "look_id": str(look.id)}))
    return look


def look_frames(host_id: UUID, epoch: int, look_id: UUID) -> list[LookPart]:
    """Return the driver's source with the signed order and its approval, for one session."""
    rows = Look.objects.filter(pk=look_id, host_id=host_id, epoch=epoch, told_at__isnull=True)
    row = rows.select_related("driver").first()
    if row is None or row.driver.state != DriverVersion.State.APPROVED:
        return []
    data = encode_bundle(row.driver.sources)
    pieces = [data[at : at + PART_BYTES] for at in range(0, len(data), PART_BYTES)]
    order, approval = signing.sign(_order(row)), msgspec.convert(row.driver.approval, Signed)
    return [
        LookPart(
            look_id=row.id,
            index=index,
            count=len(pieces),
            data=piece,
            order=order if index == 0 else None,
            approval=approval if index == 0 else None,
        )
        for index, piece in enumerate(pieces)
    ]


def _order(row: Look) -> LookOrder:
    return LookOrder(
        look_id=row.id,
        host_id=row.host_id,
        epoch=row.epoch,
        digest=row.driver.digest,
        class_name=row.driver.class_name,
        transport=row.transport,
        config=row.config,
        asked_by=str(row.asked_by_id),
    )


@atomic
def take_look(host_id: UUID, epoch: int, told: LookTold) -> None:
    """Write down what a host has seen; of another session, and said twice, it counts for nothing.

    Effect:
        None on matter. The device stays what it was: only a person admits it.
    """
    rows = Look.objects.filter(pk=told.look_id, host_id=host_id, epoch=epoch, told_at=None)
    row = rows.select_for_update(of=("self",), no_key=True).first()
    if row is None:
        return
    if len(msgspec.json.encode(told)) > MOST_TOLD_BYTES:
        text = f"the device told more than {MOST_TOLD_BYTES // 1024} KiB"
        told = LookTold(epoch=epoch, look_id=row.id, code="look.too_long", message=text)
    row.told, row.told_at = msgspec.to_builtins(told), now()
    row.save(update_fields=["told", "told_at"])
    on_commit(partial(feed.publish, "devices", {"device_id": str(row.device_id)}))
