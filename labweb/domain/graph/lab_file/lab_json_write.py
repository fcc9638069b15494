"""Write a lab as labweb's own lab file, `lab.json`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any
from uuid import UUID

from labweb.domain.graph.lab_file.lab_json_entries import SCHEMA
from labweb.domain.graph.lab_file.lab_model import (
    DeviceEntry,
    LabFile,
    LabFileLot,
    LabFileMaterial,
    LabFileSimulator,
)
from labweb.domain.graph.ports_and_connections import Connection, PortRef
from labweb.domain.resources.contents_by_lot import Phase
from labweb.domain.resources.exact_volumes import from_nl
from labweb.domain.resources.resource import Resource


def render_lab(lab: LabFile) -> bytes:
    """Write a lab so that `read_lab` gives back an equal one."""
    keys = {resource.id: resource.key for resource in lab.resources}
    value: dict[str, Any] = {
        "schema": SCHEMA,
        "name": lab.name,
        "time_zone": lab.time_zone,
        "mode": lab.mode.value,
        "materials": [_material(material) for material in lab.materials],
        "lots": [_lot(lot, lab.materials_by_id) for lot in lab.lots],
        "resources": [_resource(resource, lab, keys) for resource in lab.resources],
        "connections": [_connection(connection, keys) for connection in lab.connections],
        "hosts": [{"key": host.key, "name": host.name} for host in lab.hosts],
        "devices": [_device(device, lab, keys) for device in lab.devices],
    }
    if lab.discovered:
        value["discovered"] = list(lab.discovered)
    if lab.extra:
        value["extra"] = dict(lab.extra)
    return json.dumps(value, ensure_ascii=False, indent=2, allow_nan=False).encode() + b"\n"


def _given(**fields: object) -> dict[str, Any]:
    """Leave out what is unknown or empty, and nothing else."""
    return {name: value for name, value in fields.items() if value is not None and value != []}


def _material(material: LabFileMaterial) -> dict[str, Any]:
    return _given(
        key=material.key,
        name=material.name,
        inchikey=material.inchikey,
        density_mg_ul=material.density_mg_ul,
        concentration_mmol_l=material.concentration_mmol_l,
        ph=material.ph,
        hazards=list(material.hazards),
        groups=list(material.groups),
        incompatible_with=list(material.incompatible_with),
    )


def _lot(lot: LabFileLot, materials: Mapping[UUID, LabFileMaterial]) -> dict[str, Any]:
    return _given(
        key=lot.key,
        material=materials[lot.material_id].key,
        supplier=lot.supplier,
        number=lot.number,
        expires_on=lot.expires_on,
        purity=lot.purity,
        phase=None if lot.phase is Phase.LIQUID else lot.phase.value,
    )


def _resource(resource: Resource, lab: LabFile, keys: Mapping[UUID, str]) -> dict[str, Any]:
    contents = [
        {"lot": lab.lots_by_id[lot].key, "amount_ul": from_nl(amount_nl, 1000)}
        for lot, amount_nl in lab.contents.get(resource.id, {}).items()
    ]
    masses = [
        {"lot": lab.lots_by_id[lot].key, "amount_mg": from_nl(amount_ug, 1000)}
        for lot, amount_ug in lab.masses.get(resource.id, {}).items()
    ]
    rendered: dict[str, Any] = {
        "key": resource.key,
        "name": resource.name,
        "kind": resource.kind,
        "parent": None if resource.parent_id is None else keys[resource.parent_id],
        "pose": None if resource.pose is None else resource.pose.to_json(),
        "size_mm": None if resource.size_mm is None else list(resource.size_mm),
        "config": dict(resource.config),
    }
    optional = {
        "data": dict(resource.data),
        "extra": dict(resource.extra),
        "contents": contents,
        "masses": masses,
    }
    return rendered | {name: value for name, value in optional.items() if value}


def _end(end: PortRef, keys: Mapping[UUID, str]) -> dict[str, str]:
    return {"resource": keys[end.resource_id], "port": end.port}


def _connection(connection: Connection, keys: Mapping[UUID, str]) -> dict[str, Any]:
    dead_nl = connection.dead_volume_nl
    rendered: dict[str, Any] = {
        "key": connection.key,
        "source": _end(connection.source, keys),
        "target": _end(connection.target, keys),
        "medium": connection.medium.value,
        "is_two_way": connection.is_two_way,
        "dead_volume_ul": None if dead_nl is None else from_nl(dead_nl, 1000),
    }
    return rendered | ({"extra": dict(connection.extra)} if connection.extra else {})


def _device(device: DeviceEntry, lab: LabFile, keys: Mapping[UUID, str]) -> dict[str, Any]:
    hosts = {host.id: host.key for host in lab.hosts}
    return {
        "key": device.key,
        "name": device.name,
        "host": hosts[device.host_id],
        "driver": device.driver,
        "config": dict(device.config),
        "nodes": {role: keys[resource_id] for role, resource_id in device.nodes.items()},
        "transport": device.transport,
        "simulator": None if device.simulator is None else _simulator(device.simulator),
    }


def _simulator(simulator: LabFileSimulator) -> dict[str, Any]:
    rendered = {"model": simulator.model, "settings": dict(simulator.settings)}
    return rendered if simulator.line is None else {**rendered, "line": simulator.line}
