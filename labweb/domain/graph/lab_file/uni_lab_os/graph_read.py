"""Read a Uni-Lab-OS graph as a lab."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any
from uuid import UUID

from labweb.domain.errors import Finding
from labweb.domain.graph.lab_file.lab_check import check_lab, place_notes
from labweb.domain.graph.lab_file.lab_model import (
    LabFile,
    LabFileLot,
    LabFileMaterial,
    LabMode,
    entry_id,
    lab_id,
)
from labweb.domain.graph.lab_file.uni_lab_os.format_words import FORMAT, MEDIUM_BY_TYPE
from labweb.domain.graph.lab_file.uni_lab_os.node_as_resource import (
    NodePlace,
    kind_of,
    notes_of,
    to_resource,
)
from labweb.domain.graph.lab_file.uni_lab_os.node_liquid import UNKNOWN, NodeLiquid
from labweb.domain.graph.lab_file.uni_lab_os.nodes_and_links import Link, UniLabOsGraph, read_graph
from labweb.domain.graph.lab_file.untrusted_json import refuse_all
from labweb.domain.graph.ports_and_connections import Connection, Medium, PortRef
from labweb.domain.resources.contents_by_lot import LotId
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import KINDS


@dataclass
class NodeStock:
    """Materials, lots and contents, as vessels are read one after the other."""

    lab: UUID
    materials: dict[str, LabFileMaterial] = field(default_factory=dict)
    lots: list[LabFileLot] = field(default_factory=list)
    contents: dict[UUID, dict[LotId, int]] = field(default_factory=dict)

    def add(self, resource: Resource, holding: NodeLiquid) -> None:
        """Take up what one vessel holds: a lot of its own for each liquid in it."""
        for liquid, amount_nl in holding.amounts_nl.items():
            material = self.materials.get(liquid)
            if material is None:
                name = "Liquid of unknown identity" if liquid == UNKNOWN else liquid
                material = LabFileMaterial(
                    id=entry_id(self.lab, "material", liquid), key=liquid, name=name
                )
                self.materials[liquid] = material
            key = f"{resource.key}/{liquid}"
            lot = LabFileLot(id=entry_id(self.lab, "lot", key), key=key, material_id=material.id)
            self.lots.append(lot)
            self.contents.setdefault(resource.id, {})[LotId(str(lot.id))] = amount_nl


def read_uni_lab_os(raw: bytes, name: str) -> LabFile:
    """Read a node-link graph whole, or refuse it whole.

    Args:
        raw: The file.
        name: Name of the lab; the file has none.

    Returns:
        The lab, in mode sim, without devices: a binding adds them. Classes that the
        format's own words do not explain are `foreign`. `notes` says what a reader
        should know; `export_uni_lab_os` gives back what the file said.

    Raises:
        LabFileError: Its findings list every defect of the graph.
    """
    graph = read_graph(raw)
    lab = lab_id(name)
    stock = NodeStock(lab)
    notes: list[Finding] = list(graph.notes)
    resources = _resources(graph, lab, name, stock, notes)
    by_key = {resource.key: resource.id for resource in resources}
    result = LabFile(
        id=lab,
        name=name,
        time_zone="UTC",
        mode=LabMode.SIM,
        materials=tuple(stock.materials.values()),
        lots=tuple(stock.lots),
        resources=tuple(resources),
        contents=stock.contents,
        connections=tuple(_connection(link, lab, by_key) for link in graph.links),
        extra={FORMAT: {"top": deepcopy(dict(graph.top)), "links_field": graph.links_field}},
        notes=tuple(notes),
    )
    findings = check_lab(result)
    if findings:
        raise refuse_all(findings, "the graph")
    return replace(result, notes=(*notes, *place_notes(result)))


def _resources(
    graph: UniLabOsGraph, lab: UUID, name: str, stock: NodeStock, notes: list[Finding]
) -> list[Resource]:
    resources = []
    root_key = _synthetic_root(graph)
    root_id = None
    if root_key is not None:
        root_id = entry_id(lab, "resource", root_key)
        resources.append(_root(root_id, root_key, name))
    for node in graph.nodes:
        parent_id = root_id if node.parent is None else entry_id(lab, "resource", node.parent)
        place = NodePlace(entry_id(lab, "resource", node.key), node.key, parent_id, node.parent)
        resource, holding = to_resource(place, node.raw, kind_of(node.raw))
        resources.append(resource)
        stock.add(resource, holding)
        notes += [*notes_of(resource, node.raw), *holding.notes]
    return resources


def _synthetic_root(graph: UniLabOsGraph) -> str | None:
    """Return a free key for the root that a graph with no or several roots needs."""
    if sum(node.parent is None for node in graph.nodes) == 1:
        return None
    taken = {node.key for node in graph.nodes}
    key, number = "lab", 1
    while key in taken:
        number += 1
        key = f"lab_{number}"
    return key


def _root(root_id: UUID, key: str, name: str) -> Resource:
    return Resource(
        id=root_id,
        key=key,
        name=name,
        kind="lab",
        nature=KINDS["lab"].nature,
        parent_id=None,
        extra={FORMAT: {"synthetic": True}},
    )


def _connection(link: Link, lab: UUID, by_key: dict[str, UUID]) -> Connection:
    raw: dict[str, Any] = deepcopy(dict(link.raw))
    return Connection(
        id=entry_id(lab, "connection", link.key),
        key=link.key,
        source=PortRef(by_key[link.source], link.source_port),
        target=PortRef(by_key[link.target], link.target_port),
        medium=MEDIUM_BY_TYPE.get(str(raw.get("type")), Medium.OTHER),
        is_two_way=True,
        dead_volume_nl=None,
        extra={FORMAT: {"link": raw}},
    )
