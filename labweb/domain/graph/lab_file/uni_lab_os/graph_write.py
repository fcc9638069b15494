"""Write a lab as a Uni-Lab-OS graph."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any
from uuid import UUID

from labweb.domain.graph.elements import NL_PER_ML, NL_PER_UL
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.domain.graph.lab_file.uni_lab_os.format_words import FORMAT, MEDIUM_BY_TYPE
from labweb.domain.graph.lab_file.uni_lab_os.node_as_resource import (
    is_imported,
    is_synthetic,
    to_node,
)
from labweb.domain.graph.lab_file.uni_lab_os.node_liquid import nl_per_unit, read_holding
from labweb.domain.graph.lab_file.uni_lab_os.nodes_and_links import parse_ports
from labweb.domain.graph.ports_and_connections import Connection
from labweb.domain.resources.exact_volumes import from_nl, to_nl
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import is_vessel

_TYPE_BY_MEDIUM = {medium: name for name, medium in MEDIUM_BY_TYPE.items()}


def export_uni_lab_os(lab: LabFile) -> dict[str, Any]:
    """Render a lab in the format's node-link form.

    A lab that was imported from such a file and not changed gives back an equal file.
    Names, parents, ports and contents that did change are written as they are.
    """
    carried = lab.extra.get(FORMAT, {})
    keys = {resource.id: resource.key for resource in lab.resources if not is_synthetic(resource)}
    nodes = [_node(resource, lab, keys) for resource in lab.resources if not is_synthetic(resource)]
    _move_children(nodes, lab, keys)
    value: dict[str, Any] = {"nodes": nodes}
    links_field = carried.get("links_field", "links")
    if links_field is not None or lab.connections:
        value[links_field or "links"] = [_link(link, keys) for link in lab.connections]
    return value | deepcopy(dict(carried.get("top", {})))


def _node(resource: Resource, lab: LabFile, keys: Mapping[UUID, str]) -> dict[str, Any]:
    parent = _parent(resource, keys)
    if not is_imported(resource):
        node = {
            "id": resource.key,
            "name": resource.name,
            "parent": parent,
            "children": [keys[child.id] for child in lab.tree.children.get(resource.id, ())],
            "type": resource.kind,
            "class": "",
            "config": _sized(resource.config),
            "data": dict(resource.data),
        }
    else:
        node = to_node(resource)
        if resource.extra[FORMAT]["parent"] != parent:
            node["parent"] = parent
            node.pop("parent_uuid", None)
    if is_vessel(resource.kind):
        _write_contents(node, resource, lab)
    return node


def _sized(config: Mapping[str, Any]) -> dict[str, Any]:
    """Write how much is held as the format says it: `max_volume` in mL, if it is whole nL."""
    found = dict(config)
    capacity_ul = found.get("capacity_ul")
    if isinstance(capacity_ul, int | float) and not isinstance(capacity_ul, bool):
        capacity_nl = to_nl(capacity_ul, NL_PER_UL)
        if capacity_nl is not None:
            found["max_volume"] = from_nl(capacity_nl, NL_PER_ML)
            del found["capacity_ul"]
    return found


def _parent(resource: Resource, keys: Mapping[UUID, str]) -> str | None:
    return None if resource.parent_id is None else keys.get(resource.parent_id)


def _move_children(nodes: list[dict[str, Any]], lab: LabFile, keys: Mapping[UUID, str]) -> None:
    """Take a resource that has moved out of the old parent's list and into the new one's."""
    by_key = {str(node["id"]): node for node in nodes}
    for resource in lab.resources:
        if not is_imported(resource):
            continue
        parent, was = _parent(resource, keys), resource.extra[FORMAT]["parent"]
        if parent == was:
            continue
        if was in by_key and resource.key in (by_key[was].get("children") or []):
            by_key[was]["children"].remove(resource.key)
        children = by_key[parent].get("children") if parent in by_key else None
        if isinstance(children, list) and resource.key not in children:
            children.append(resource.key)


def _write_contents(node: dict[str, Any], resource: Resource, lab: LabFile) -> None:
    """Write contents that differ from what the node says."""
    amounts_nl: dict[str, int] = {}
    for lot, amount_nl in lab.contents.get(resource.id, {}).items():
        material = lab.materials_by_id[lab.lots_by_id[lot].material_id].key
        amounts_nl[material] = amounts_nl.get(material, 0) + amount_nl
    if read_holding(resource.key, node).amounts_nl == amounts_nl:
        return
    scale = nl_per_unit(node.get("config"))
    listed = {liquid: from_nl(amount_nl, scale) for liquid, amount_nl in amounts_nl.items()}
    data = node.get("data") if isinstance(node.get("data"), dict) else {}
    data = {field: value for field, value in (data or {}).items() if not _tells_liquid(field)}
    if scale == 1000:
        data["liquids"] = [[liquid, amount] for liquid, amount in listed.items()]
    else:
        data["liquid"] = [
            {"liquid_type": liquid, "liquid_volume": amount} for liquid, amount in listed.items()
        ]
    node["data"] = data
    node.pop("current_volume", None)
    node.pop("chemical", None)


def _tells_liquid(field: str) -> bool:
    return field in {"liquid", "liquids", "pending_liquids", "liquid_type", "liquid_volume"}


def _link(connection: Connection, keys: Mapping[UUID, str]) -> dict[str, Any]:
    carried = connection.extra.get(FORMAT)
    source = keys[connection.source.resource_id]
    target = keys[connection.target.resource_id]
    ports = (connection.source.port, connection.target.port)
    if not isinstance(carried, Mapping):
        return {
            "id": connection.key,
            "source": source,
            "target": target,
            "type": _TYPE_BY_MEDIUM.get(connection.medium, "logical"),
            "port": {source: ports[0], target: ports[1]},
        }
    link: dict[str, Any] = deepcopy(dict(carried["link"]))
    if str(link["source"]) != source or str(link["target"]) != target:
        link |= {"source": source, "target": target, "port": {source: ports[0], target: ports[1]}}
    elif parse_ports(link) != ports:
        link["port"] = {source: ports[0], target: ports[1]}
    return link
