"""Which resources are parts of a device itself, and which it only acts through."""

from __future__ import annotations

from uuid import UUID

import msgspec

from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.graph.device_parts import injected
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


def own_parts(device: Device) -> set[UUID]:
    """Return the parts that leave the tree with a device, the outermost of each.

    A part is its own where its driver brings one of this kind for the role that is bound there,
    and no other device acts through it.
    """
    own = _own(device)
    above = resource_selectors.ancestors(own)
    return {one for one in own if not own.intersection(above[one])}


def joins_parts_of(lab: Lab, one_id: UUID, other_id: UUID) -> str:
    """Return the name of the device of which both resources are parts; "": there is none."""
    wanted = {one_id, other_id}
    for device in enrollment_selectors.present_devices(lab):
        nodes = {UUID(node) for node in device.nodes.values()}
        if wanted <= nodes and wanted <= _own(device):
            return device.name
    return ""


def _own(device: Device) -> set[UUID]:
    spec = msgspec.convert(device.driver.spec, DriverSpec)
    made = injected(spec, device.config, key=device.key, name=device.name)
    kinds = {
        UUID(device.nodes[role]): part.kind
        for part in made.parts
        for role in part.roles
        if role in device.nodes
    }
    ids = kinds.keys() - enrollment_selectors.nodes_of_others(device)
    rows = resource_selectors.rows(ids).filter(lab=device.lab, is_archived=False)
    return {row.id for row in rows if row.kind == kinds[row.id]}
