"""Reads of photos of devices."""

from __future__ import annotations

from labweb.domain.errors import NotFoundError
from labweb.enrollment.selectors import Device
from labweb.telemetry.models import DevicePhoto


def newest_photo(device: Device) -> DevicePhoto | None:
    """Return the photo of a device that is shown; None: nobody brought one."""
    rows = DevicePhoto.objects.filter(device=device).select_related("file", "brought_by")
    return rows.order_by("-id").first()


def find_photo(device: Device) -> DevicePhoto:
    """Return the photo of a device.

    Raises:
        NotFoundError: Nobody brought one.
    """
    row = newest_photo(device)
    if row is None:
        raise NotFoundError(f"there is no photo of {device.name}", code="photo.not_found")
    return row
