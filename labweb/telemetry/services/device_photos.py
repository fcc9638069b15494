"""Keep a photo of a device: what is brought is hostile until it has been written anew."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import IO
from uuid import UUID

from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import now
from labweb.common.files.picture_process import read_apart
from labweb.domain.action_files import KEPT_ONLY
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import StateError
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device
from labweb.resources import selectors as resource_selectors
from labweb.telemetry.models import DevicePhoto, File
from labweb.telemetry.services.kept_files import (
    JPEG,
    Upload,
    digest_of,
    read_and_keep,
    received,
    room,
)

MOST_PHOTO_BYTES = 16 * 2**20


def keep_photo(device_id: UUID, stream: IO[bytes], *, actor: User) -> DevicePhoto:
    """Keep a photo of a device, written anew as JPEG without what else the file told.

    Args:
        device_id: Which.
        stream: A JPEG, PNG or WebP file of at most `MOST_PHOTO_BYTES`; what it is, its bytes say.
        actor: Who brings it.

    Raises:
        NotFoundError: There is no such device.
        ForbiddenError: The actor may not admit where it stands.
        DefinitionError: `photo.unreadable`, `photo.too_many_pixels`, `file.too_large`,
            `file.empty`. Nothing was written.

    Effect:
        None on matter. Writes bytes under the data directory, rows, and one line of audit.
    """
    device = enrollment_selectors.find_device(device_id)
    nodes = enrollment_selectors.node_ids(device)
    resource_selectors.require(actor, Permission.ADMIT, nodes)
    with room() as folder:
        brought, photo = folder / "brought", folder / "photo.jpg"
        received(stream, brought, MOST_PHOTO_BYTES)
        read_apart("labweb.common.files.photos", brought, photo)
        return _kept(photo, device, actor)


@atomic
def _kept(photo: Path, device: Device, actor: User) -> DevicePhoto:
    sha256 = digest_of(photo)
    row = DevicePhoto.objects.create(
        device=device,
        file=_file_of(photo, sha256, device, actor),
        brought_by=actor,
        brought_at=now(),
    )
    detail = {"sha256": sha256, "file_id": str(row.file_id)}
    account_services.write_audit("device.photo", str(device.id), actor=actor, detail=detail)
    on_commit(partial(feed.publish, "devices", {"device_id": str(device.id)}))
    return row


def _file_of(photo: Path, sha256: str, device: Device, actor: User) -> File:
    """Keep the bytes; a photo that was kept of this device before is the same file."""
    name = f"{device.key[:200]}.{sha256[:12]}.jpg"
    with photo.open("rb") as stream:
        upload = Upload(stream, name, JPEG, KEPT_ONLY, device=device)
        try:
            return read_and_keep(upload, name, photo, sha256, lab=device.lab, actor=actor)
        except StateError as error:
            if error.code != "file.exists":
                raise
            return File.objects.get(pk=error.context["file_id"])
