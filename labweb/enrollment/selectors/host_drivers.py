"""Reads of the driver sources that a host may fetch."""

from __future__ import annotations

from uuid import UUID

from django.db.models import Q

from labweb.enrollment.models import (
    Device,
    DriverVersion,
)


def driver_for_host(host_id: UUID, digest: str) -> DriverVersion | None:
    """Return an approved version that a device of the host uses, or is to; None: there is none."""
    rows = Device.objects.filter(host_id=host_id, state=Device.State.ENROLLED)
    used = rows.filter(Q(driver__digest=digest) | Q(next_driver__digest=digest))
    if not used.exists():
        return None
    state = DriverVersion.State.APPROVED
    return DriverVersion.objects.filter(digest=digest, state=state).first()
