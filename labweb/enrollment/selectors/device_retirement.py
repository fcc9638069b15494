"""Reads for the end of a device: who is not retired, and what may become of one."""

from __future__ import annotations

from collections.abc import Collection
from uuid import UUID

from labweb.enrollment.models import Candidate, Device
from labweb.enrollment.selectors.returning_devices import taken_from
from labweb.resources.selectors import Lab


def present_devices(lab: Lab) -> list[Device]:
    """Return the devices of a lab that are not retired, with host and drivers."""
    rows = Device.objects.filter(lab=lab).exclude(state=Device.State.RETIRED)
    return list(rows.select_related("host", "driver", "next_driver"))


def nodes_of_others(device: Device) -> Collection[UUID]:
    """Return the resources through which other devices of the lab act."""
    rows = present_devices(device.lab)
    return {UUID(node) for row in rows if row.pk != device.pk for node in row.nodes.values()}


def is_first_review(device: Device) -> bool:
    """Tell whether a device was taken up from the inbox, and nobody has admitted it since."""
    seen = taken_from(device)
    if seen is None or seen.decided_at is None or seen.state != Candidate.State.TAKEN_UP:
        return False
    return device.admitted_at is None or device.admitted_at < seen.decided_at
