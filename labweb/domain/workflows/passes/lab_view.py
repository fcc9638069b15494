"""What the compiler sees of a lab: one state of it, frozen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from uuid import UUID

from labweb.domain.crutd.settlement import ResourceState, Snapshot
from labweb.domain.crutd.snapshot import Facts
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.graph.ports_and_connections import Medium, PhysicalGraph
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import is_vessel
from labweb.domain.resources.resource_tree import Tree

_CARRYING = (Medium.THERMAL, Medium.MECHANICAL)


@dataclass(frozen=True, kw_only=True)
class PlannerView:
    """One lab at one moment."""

    tree: Tree
    graph: PhysicalGraph
    devices: tuple[AdmittedDevice, ...]
    """Devices that are admitted; nothing else may act."""

    snapshot: Snapshot
    """State of every resource, with contents."""

    densities_mg_ul: Mapping[LotId, float | None] = field(default_factory=dict)
    """Density by lot. None, or no entry: nobody knows."""

    facts: Facts | None = None
    """Every lot and material of the lab; None where nobody knows them."""

    lots: Mapping[str, LotId] = field(default_factory=dict)
    """Lot by its key."""

    materials: Mapping[str, UUID] = field(default_factory=dict)
    """Material by its key."""

    @cached_property
    def devices_by_key(self) -> tuple[AdmittedDevice, ...]:
        """Devices in the order in which ties are broken."""
        return tuple(sorted(self.devices, key=lambda device: (device.key, device.id)))

    @cached_property
    def device_by_node(self) -> dict[UUID, AdmittedDevice]:
        """Device by each of its resources."""
        return {node: device for device in self.devices_by_key for node in device.nodes.values()}

    @cached_property
    def names(self) -> dict[str, str]:
        """Name by reference, for sentences."""
        names = {str(device.id): device.name for device in self.devices}
        return names | {str(resource.id): resource.name for resource in self.tree.resources}

    def find_device(self, reference: UUID) -> AdmittedDevice | None:
        """Return the device of that id, or the one that has a resource of that id."""
        found = next((device for device in self.devices if device.id == reference), None)
        return found or self.device_by_node.get(reference)

    def state(self, resource_id: UUID) -> ResourceState | None:
        """Return the state of a resource, or None when the view has none."""
        return self.snapshot.get(resource_id)

    def carriers(self, vessel_id: UUID) -> Iterator[Resource]:
        """Yield what a vessel stands in or on, nearest first, then what is coupled to it.

        Coupled is a thermal or mechanical connection. Names play no part.
        """
        seen: set[UUID] = set()
        for ancestor in self.tree.ancestors(vessel_id):
            seen.add(ancestor.id)
            yield ancestor
        for connection in self.graph.by_resource.get(vessel_id, ()):
            if connection.medium not in _CARRYING:
                continue
            for end in (connection.source, connection.target):
                other = self.tree.by_id.get(end.resource_id)
                if other is not None and other.id != vessel_id and other.id not in seen:
                    seen.add(other.id)
                    yield other

    def carried(self, resource_id: UUID, place_id: UUID) -> PlannerView:
        """Return the lab as it is once a thing, with all in it, stands in another place."""
        resources = tuple(
            replace(one, parent_id=place_id) if one.id == resource_id else one
            for one in self.tree.resources
        )
        return replace(self, tree=Tree(resources))

    def vessels_on(self, device: AdmittedDevice) -> set[UUID]:
        """Return the vessels that stand on or are coupled to a device's resources."""
        nodes = set(device.nodes.values())
        found = {
            below.id
            for node in nodes
            if node in self.tree.by_id
            for below in self.tree.descendants(node)
            if is_vessel(below.kind)
        }
        for node in nodes:
            for connection in self.graph.by_resource.get(node, ()):
                if connection.medium in _CARRYING:
                    ends = {connection.source.resource_id, connection.target.resource_id}
                    found |= {e for e in ends if e in self.tree.by_id} - nodes
        return found

    def cells_of(self, device: AdmittedDevice) -> set[UUID]:
        """Return the vessels to which a device's electrodes are connected.

        The electrical connection ends at the vessel, or at the place in which it stands.
        """
        nodes = set(device.nodes.values())
        ends = {
            end.resource_id
            for node in nodes
            for connection in self.graph.by_resource.get(node, ())
            if connection.medium == Medium.ELECTRICAL
            for end in (connection.source, connection.target)
        }
        wired = [self.tree.by_id[end] for end in ends - nodes if end in self.tree.by_id]
        there = [one for end in wired for one in (end, *self.tree.descendants(end.id))]
        return {one.id for one in there if is_vessel(one.kind)}
