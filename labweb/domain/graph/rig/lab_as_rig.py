"""A lab of ours as a rig."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any
from uuid import UUID

from labweb.domain.graph.elements import Element, ElementRole, Tube
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.graph.lab_file.lab_model import LabFile, LabMode
from labweb.domain.graph.ports_and_connections import Connection
from labweb.domain.graph.rig.nodes_as_elements import find_defects
from labweb.domain.graph.rig.rig_model import Rig, RigFormat
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import is_vessel

COMMON_PORT = "common"
"""Name of a rotary valve's fixed port, unless its `config.common_port` says otherwise."""

_NL_PER_ML = 1_000_000

_ROLES: Mapping[str, ElementRole] = {
    "rotary_valve": ElementRole.VALVE,
    "solenoid_valve": ElementRole.SOLENOID,
    "syringe_pump": ElementRole.PUMP,
    "cartridge": ElementRole.CARTRIDGE,
    "vacuum_controller": ElementRole.VACUUM,
    "vacuum_line": ElementRole.VACUUM,
}
_TRANSMITTER = "transmitter"
_INFUSES = "infusion_pump"
"""Role of a drive with a syringe clamped in: no plan moves liquid with it."""


def is_lab(value: object) -> bool:
    """Tell whether a decoded file is a `lab.json`."""
    return isinstance(value, Mapping) and "schema" in value and "nodes" not in value


def rig_of_lab(raw: bytes) -> Rig:
    """Read a `lab.json` as a rig.

    Raises:
        LabFileError: As `read_lab`.
    """
    lab = read_lab(raw)
    keys = {resource.id: resource.key for resource in lab.resources}
    bare = rig_of(lab.resources, lab.connections, [device.nodes for device in lab.devices])
    said = {one.key: _attributes(lab, one, keys) for one in lab.resources}
    elements = tuple(
        replace(one, attributes={**one.attributes, **said[one.key]}) for one in bare.elements
    )
    return replace(bare, elements=elements, text=raw.decode("utf-8-sig"))


def rig_of(
    resources: Iterable[Resource],
    connections: Iterable[Connection],
    nodes: Iterable[Mapping[str, UUID]],
) -> Rig:
    """Return the plumbing of a lab as it stands, without what is in its vessels.

    Args:
        resources: Everything that a connection joins, and what else is asked about.
        connections: Those between these resources.
        nodes: For each device, its resources by their role in the driver.
    """
    resources, nodes = tuple(resources), tuple(nodes)
    selecting = {
        one["valve"] for one in nodes if "valve" in one and one["valve"] == one.get("pump")
    }
    keys = {resource.id: resource.key for resource in resources}
    tubes = tuple(tube_of_connection(connection, keys) for connection in connections)
    roles = {node: role for one in nodes for role, node in sorted(one.items())}
    elements = tuple(
        replace(
            _ported(_element(resource, roles.get(resource.id), resource.id in selecting), tubes),
            kind=_class_of(resource, roles.get(resource.id)),
            attributes=_told(resource, keys) | {"is_driven": resource.id in roles},
        )
        for resource in resources
    )
    return Rig(RigFormat.LABWEB, elements, tubes, find_defects(elements, tubes))


def render_graph(lab: LabFile) -> bytes:
    """Write a lab as a `lab.json` for its graph alone.

    How its instruments are reached is no part of that, and need not hold: a lab that simulates
    may have admitted an instrument that nobody simulates.
    """
    devices = tuple(
        replace(device, transport=f"tcp://{place}", simulator=None)
        for place, device in enumerate(lab.devices)
    )
    return render_lab(replace(lab, mode=LabMode.LIVE, devices=devices))


def _class_of(resource: Resource, role: str | None) -> str:
    """Return the kind; that of a transmitter says what it reads, by the role of its driver."""
    if resource.kind == _TRANSMITTER and role is not None:
        return f"{role}_{_TRANSMITTER}"
    return resource.kind


def _element(resource: Resource, role: str | None, selects: bool) -> Element:  # noqa: FBT001 - as `selects` of `element_of_resource`
    """Return what a resource does; a syringe that only infuses draws from no port by choice."""
    element = element_of_resource(resource, selects=selects)
    return replace(element, role=ElementRole.OTHER) if role == _INFUSES else element


def _ported(element: Element, tubes: Iterable[Tube]) -> Element:
    """Give a selector the ports that its settings count, unless a tube is at yet another."""
    count = element.attributes.get("ports_count")
    if element.role is not ElementRole.VALVE or not isinstance(count, int):
        return element
    ports = {str(place) for place in range(1, count + 1)} | {element.common_port or COMMON_PORT}
    joined = {tube.source_port for tube in tubes if tube.source == element.key}
    joined |= {tube.target_port for tube in tubes if tube.target == element.key}
    return replace(element, ports=frozenset(ports)) if joined <= ports else element


def _attributes(lab: LabFile, resource: Resource, keys: Mapping[UUID, str]) -> dict[str, Any]:
    """Return what the file says beside the plumbing: settings, what it stands on, contents."""
    materials = {lot: lab.materials_by_id[lot_.material_id] for lot, lot_ in lab.lots_by_id.items()}
    liquid = [
        {
            "liquid_type": materials[lot].name,
            "liquid_volume": amount_nl / _NL_PER_ML,
            "material": materials[lot].key,
            "groups": list(materials[lot].groups),
            "incompatible_with": list(materials[lot].incompatible_with),
            "inchikey": materials[lot].inchikey,
        }
        for lot, amount_nl in lab.contents.get(resource.id, {}).items()
    ]
    return _told(resource, keys) | {"data": {"liquid": liquid}}


def _told(resource: Resource, keys: Mapping[UUID, str]) -> dict[str, Any]:
    """Return what is said of a resource beside the plumbing, but for its contents."""
    parent = keys.get(resource.parent_id) if resource.parent_id else None
    said = {"gas_type": resource.config.get("gas"), "chemical": resource.config.get("filling")}
    own = {"config": dict(resource.config), "parent": parent}
    return own | {name: value for name, value in said.items() if value}


def element_of_resource(resource: Resource, *, selects: bool = False) -> Element:
    """Return what a resource does with liquid; `selects`: the pump turns a valve of its own."""
    role = _ROLES.get(resource.kind)
    if role is None:
        role = ElementRole.VESSEL if is_vessel(resource.kind) else ElementRole.OTHER
    if role is ElementRole.VESSEL and resource.config.get("gas"):
        role = ElementRole.GAS
    capacity_ul = resource.config.get("capacity_ul")
    capacity_nl = None
    if role is ElementRole.PUMP and isinstance(capacity_ul, int | float) and capacity_ul > 0:
        capacity_nl = round(capacity_ul * 1000)
    return Element(
        key=resource.key,
        role=role,
        kind=resource.kind,
        common_port=str(resource.config.get("common_port", COMMON_PORT))
        if role is ElementRole.VALVE
        else None,
        numbered=role is ElementRole.VALVE,
        selects=selects,
        capacity_nl=capacity_nl,
        attributes=resource.config,
    )


def tube_of_connection(connection: Connection, keys: Mapping[UUID, str]) -> Tube:
    """Return a connection as a tube between keys."""
    return Tube(
        key=connection.key,
        source=keys[connection.source.resource_id],
        source_port=connection.source.port,
        target=keys[connection.target.resource_id],
        target_port=connection.target.port,
        medium=connection.medium,
        is_two_way=connection.is_two_way,
        dead_volume_nl=connection.dead_volume_nl,
    )
