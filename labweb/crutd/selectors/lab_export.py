"""A stored lab as a lab file again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any
from uuid import UUID

import msgspec

from labweb.crutd.selectors import amounts
from labweb.domain.crutd.ledger import Amount
from labweb.domain.graph.lab_file.lab_model import (
    DeviceEntry,
    HostEntry,
    LabFile,
    LabFileLot,
    LabFileMaterial,
    LabMode,
)
from labweb.domain.resources.contents_by_lot import LotId, Phase
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab

CARRIED = "carried"
HOSTS = "hosts"
DEVICES = "devices"
DISCOVERED = "discovered"


def file_extra(lab_file: LabFile) -> dict[str, Any]:
    """Return what of a lab file is kept beside its rows, for `lab_file_of`.

    Hosts and devices are what the file declares; what was enrolled has rows of its own.
    """
    return {
        CARRIED: dict(lab_file.extra),
        HOSTS: msgspec.to_builtins(lab_file.hosts),
        DEVICES: msgspec.to_builtins(lab_file.devices),
        DISCOVERED: list(lab_file.discovered),
    }


def lab_file_of(lab: Lab) -> LabFile:
    """Return a lab as its file would say it now.

    A lab that was imported and not changed gives back an equal lab file. Places, data,
    contents and devices that did change are as they are.
    """
    tree = resource_selectors.tree_of(resource_selectors.resources_of(lab))
    lots = tuple(_lots(lab))
    found = amounts(tree.by_id)
    devices, discovered = _devices(lab)
    return LabFile(
        id=lab.id,
        name=lab.name,
        time_zone=lab.time_zone,
        mode=LabMode(lab.mode),
        materials=tuple(_materials(lab)),
        lots=lots,
        resources=tree.resources,
        contents=_listed(tree.by_id, lots, {key: _nl(held) for key, held in found.items()}),
        masses=_listed(tree.by_id, lots, {key: _ug(held) for key, held in found.items()}),
        connections=resource_selectors.graph_of(lab).connections,
        hosts=_hosts(lab),
        devices=devices,
        discovered=discovered,
        extra=lab.extra.get(CARRIED, {}),
    )


def _materials(lab: Lab) -> Iterable[LabFileMaterial]:
    for row in resource_selectors.materials_of(lab).order_by("position", "key"):
        yield LabFileMaterial(
            id=row.id,
            key=row.key,
            name=row.name,
            inchikey=row.inchikey or None,
            density_mg_ul=row.density_mg_ul,
            concentration_mmol_l=row.concentration_mmol_l,
            ph=row.ph,
            hazards=tuple(row.hazards),
            groups=tuple(row.groups),
            incompatible_with=tuple(row.incompatible_with),
        )


def _lots(lab: Lab) -> Iterable[LabFileLot]:
    for row in resource_selectors.lots_of(lab).order_by("position", "key"):
        yield LabFileLot(
            id=row.id,
            key=row.key,
            material_id=row.material_id,
            supplier=row.supplier or None,
            number=row.number or None,
            expires_on=None if row.expires_on is None else row.expires_on.isoformat(),
            purity=row.purity or None,
            phase=Phase(row.phase),
        )


def _nl(held: Mapping[LotId, Amount]) -> dict[LotId, int]:
    return {lot: amount.nl for lot, amount in held.items() if amount.nl}


def _ug(held: Mapping[LotId, Amount]) -> dict[LotId, int]:
    return {lot: amount.ug for lot, amount in held.items() if amount.ug}


def _listed(
    resources: Mapping[UUID, object],
    lots: Iterable[LabFileLot],
    held: Mapping[UUID, Mapping[LotId, int]],
) -> dict[UUID, dict[LotId, int]]:
    """Return what each vessel holds, in the order of the resources and of the lots."""
    order = [LotId(str(lot.id)) for lot in lots]
    return {
        resource: {lot: held[resource][lot] for lot in order if lot in held[resource]}
        for resource in resources
        if held.get(resource)
    }


def _hosts(lab: Lab) -> tuple[HostEntry, ...]:
    declared = msgspec.convert(lab.extra.get(HOSTS, []), list[HostEntry])
    found = {host.id: host for host in declared}
    for row in enrollment_selectors.hosts_of(lab).order_by("key"):
        found[row.id] = HostEntry(id=row.id, key=row.key, name=row.name)
    return tuple(found.values())


def _devices(lab: Lab) -> tuple[tuple[DeviceEntry, ...], tuple[str, ...]]:
    """Return devices as declared, brought up to date by what was enrolled, and candidates."""
    declared = msgspec.convert(lab.extra.get(DEVICES, []), list[DeviceEntry])
    found = {device.id: device for device in declared}
    candidates = dict.fromkeys(lab.extra.get(DISCOVERED, []))
    for row in enrollment_selectors.devices_of(lab).select_related("driver").order_by("key"):
        if row.state == Device.State.RETIRED:
            found.pop(row.id, None)
        else:
            found[row.id] = _device(row, found.get(row.id))
        if row.state == Device.State.CANDIDATE:
            candidates.setdefault(row.key)
        else:
            candidates.pop(row.key, None)
    return tuple(found.values()), tuple(candidates)


def _device(row: Device, declared: DeviceEntry | None) -> DeviceEntry:
    nodes = {role: UUID(node) for role, node in row.nodes.items()}
    simulator = None if declared is None else declared.simulator
    transport = row.transport if declared is None else declared.transport
    return DeviceEntry(
        id=row.id,
        key=row.key,
        name=row.name,
        host_id=row.host_id,
        driver=f"{row.driver.module}:{row.driver.class_name}",
        config=row.config,
        nodes=nodes,
        transport=transport,
        simulator=simulator,
    )
