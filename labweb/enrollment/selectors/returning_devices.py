"""Reads of what a device was when it was admitted last, and of what it is."""

from __future__ import annotations

from uuid import UUID

import msgspec

from labweb.domain.enrollment.device_review import KeptReview
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.enrollment.returning_device import (
    Difference,
    KnownDevice,
    compare_capabilities,
    compare_identity,
)
from labweb.enrollment.models import Candidate, Device, DriverVersion
from labweb.resources import selectors as resource_selectors


def taken_from(device: Device) -> Candidate | None:
    """Return what a host saw and a person took up as this device; None: it came with the lab."""
    rows = Candidate.objects.filter(device=device).select_related("decided_by", "host")
    return rows.order_by("-decided_at").first()


def places_of(device: Device) -> dict[str, str]:
    """Return where a device acts in the tree, from the lab downwards, by role."""
    nodes = {role: UUID(node) for role, node in device.nodes.items()}
    above = resource_selectors.ancestors(nodes.values())
    names = resource_selectors.names(
        {*nodes.values(), *(up for line in above.values() for up in line)}
    )
    return {
        role: " / ".join(names[up] for up in [*reversed(above[node]), node] if up in names)
        for role, node in nodes.items()
    }


def present_of(device: Device) -> KnownDevice:
    """Return what a device is, as far as anybody knows."""
    seen = taken_from(device)
    return KnownDevice(
        driver_digest=device.driver.digest,
        transport=device.transport,
        host=device.host.key,
        config=dict(device.config),
        nodes=places_of(device),
        public_key="" if seen is None else seen.public_key,
        serial="" if seen is None else seen.serial,
        model="" if seen is None else seen.model,
        label=label_of(device, seen),
    )


def kept_review(device: Device) -> KeptReview | None:
    """Return what a person has filled in since the last decision; None: nothing."""
    return msgspec.convert(device.kept_review, KeptReview) if device.kept_review else None


def label_of(device: Device, seen: Candidate | None) -> str:
    """Return what somebody last read on the thing itself; "" for nobody."""
    kept = kept_review(device)
    told = "" if kept is None else kept.label
    return told or device.admitted_as.get("label", "") or ("" if seen is None else seen.label)


def changes_since_admission(device: Device) -> list[Difference] | None:
    """List what is not as it was when a person admitted it last; None: nobody knows."""
    if not device.admitted_as:
        return None
    before, after = msgspec.convert(device.admitted_as, KnownDevice), present_of(device)
    found = compare_identity(before, after)
    if before.driver_digest != after.driver_digest:
        known = DriverVersion.objects.filter(digest=before.driver_digest).first()
        if known is not None:
            old = msgspec.convert(known.spec, DriverSpec)
            found += compare_capabilities(old, msgspec.convert(device.driver.spec, DriverSpec))
    return found
