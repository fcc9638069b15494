"""What must hold for a lab as a whole, whichever file it came from."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from uuid import UUID

from labweb.domain.errors import Finding
from labweb.domain.graph.lab_file.lab_model import UNI_LAB_OS, DeviceEntry, LabFile, LabMode
from labweb.domain.graph.lab_file.name_and_tree_bounds import check_bounds
from labweb.domain.graph.lab_file.resource_config import check_config
from labweb.domain.graph.lab_file.size_contradictions import check_sizes
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.resources.contents_by_lot import LotId, Phase, total_nl
from labweb.domain.resources.exact_volumes import to_nl
from labweb.domain.resources.placement import check_places
from labweb.domain.resources.resource import Resource
from labweb.domain.resources.resource_kinds import is_vessel
from labweb.domain.resources.resource_tree import check_tree

PLACE_CODES = frozenset(
    {
        "place.wrong_kind",
        "place.occupied",
        "place.not_in_slot",
        "crutd.no_place",
        "pose.outside",
        "lab_file.volume",
    }
)
"""What `place_notes` finds: as kinds become known, it is looked at again."""


def check_lab(lab: LabFile) -> list[Finding]:
    """List everything that keeps this from being a lab; an empty list means it is one."""
    broken = check_tree(lab.resources)
    return [
        *_check_unique(lab),
        *broken,
        *_check_root(lab),
        *check_bounds(lab),
        *_check_configs(lab),
        *([] if broken else [*_check_places(lab), *_check_sizes(lab)]),
        *_check_contents(lab),
        *_check_ends(lab),
        *_check_devices(lab),
        *_check_discovered(lab),
        *_check_lines(lab),
        *_check_valve_ports(lab),
    ]


def _check_unique(lab: LabFile) -> list[Finding]:
    sorts: dict[str, Iterable[str]] = {
        "materials": (entry.key for entry in lab.materials),
        "lots": (entry.key for entry in lab.lots),
        "connections": (entry.key for entry in lab.connections),
        "hosts": (entry.key for entry in lab.hosts),
        "devices": (entry.key for entry in lab.devices),
    }
    return [
        Finding("lab_file.duplicate", f"{count} entries of {sort} have the key {key!r}", key)
        for sort, keys in sorts.items()
        for key, count in Counter(keys).items()
        if count > 1
    ]


def _check_root(lab: LabFile) -> list[Finding]:
    roots = [resource.key for resource in lab.resources if resource.parent_id is None]
    if len(roots) == 1:
        return []
    listed = ", ".join(repr(key) for key in roots[:5]) or "none"
    message = f"a lab has exactly one resource without a parent; this has {len(roots)}: {listed}"
    return [Finding("lab_file.root", message, "resources", {"roots": roots[:100]})]


def _check_configs(lab: LabFile) -> list[Finding]:
    return [
        finding
        for resource in lab.resources
        for finding in check_config(resource.kind, resource.config, f"resources[{resource.key!r}]")
    ]


def _check_places(lab: LabFile) -> Iterator[Finding]:
    """Refuse what stands where it cannot; what another format says so is a note of its reader."""
    for finding in check_places(lab.tree):
        if UNI_LAB_OS not in lab.tree.by_key[finding.subject].extra:
            message = f"resources[{finding.subject!r}]: parent: {finding.message}"
            yield replace(finding, message=message)


def _check_sizes(lab: LabFile) -> Iterator[Finding]:
    for finding in check_sizes(lab.tree):
        if UNI_LAB_OS not in lab.tree.by_key[finding.subject].extra:
            yield finding


def place_notes(lab: LabFile) -> list[Finding]:
    """List what stands where it cannot by a format that does not ask, by node; it is kept."""
    return [
        replace(finding, message=f"{finding.subject}: {finding.message}; kept as written")
        for finding in (*check_places(lab.tree), *check_sizes(lab.tree))
        if UNI_LAB_OS in lab.tree.by_key[finding.subject].extra
    ]


def _check_contents(lab: LabFile) -> list[Finding]:
    findings: list[Finding] = []
    both = (
        ("contents", "capacity_ul", "µL", lab.contents),
        ("masses", "capacity_mg", "mg", lab.masses),
    )
    for field, limit, unit, held in both:
        for resource_id, contents in held.items():
            resource = lab.tree.by_id.get(resource_id)
            if resource is None:
                continue
            findings += _check_phases(lab, resource, field, contents)
            subject = f"resources[{resource.key!r}]"
            about = {"field": field}
            if not is_vessel(resource.kind):
                message = f"{subject}: {field}: a {resource.kind} holds no liquid"
                findings.append(Finding("lab_file.no_vessel", message, resource.key, about))
                continue
            capacity, total = resource.config.get(limit), total_nl(contents)
            if isinstance(capacity, int | float) and total > capacity * 1000:
                message = (
                    f"{subject}: {field}: {total / 1000} {unit} in a vessel of {capacity} {unit}"
                )
                findings.append(Finding("lab_file.overfull", message, resource.key, about))
    return findings


def _check_phases(
    lab: LabFile, resource: Resource, field: str, contents: Mapping[LotId, int]
) -> Iterator[Finding]:
    for lot_id in contents:
        lot = lab.lots_by_id.get(lot_id)
        if lot is not None and (lot.phase is Phase.LIQUID) != (field == "contents"):
            what = f"lot {lot.key!r} is a {lot.phase.value}"
            message = f"resources[{resource.key!r}]: {field}: {what}"
            yield Finding("lab_file.phase", message, resource.key, {"field": field})


def _check_ends(lab: LabFile) -> list[Finding]:
    return [
        Finding(
            "lab_file.dangling_end",
            f"connections[{connection.key!r}]: {name}: no such resource in the file",
            connection.key,
            {"field": name},
        )
        for connection in lab.connections
        for name, end in (("source", connection.source), ("target", connection.target))
        if end.resource_id not in lab.tree.by_id
    ]


def _check_devices(lab: LabFile) -> list[Finding]:
    owners: dict[UUID, set[str]] = defaultdict(set)
    findings: list[Finding] = []
    for device in lab.devices:
        findings += _check_carrier(device, lab.mode)
        for resource_id in device.nodes.values():
            owners[resource_id].add(device.key)
    for resource_id, keys in owners.items():
        if len(keys) > 1 and resource_id in lab.tree.by_id:
            key = lab.tree.by_id[resource_id].key
            message = f"resource {key!r} is a node of several devices: {', '.join(sorted(keys))}"
            findings.append(Finding("lab_file.node_shared", message, key, {"field": "nodes"}))
    return findings


def _check_discovered(lab: LabFile) -> list[Finding]:
    known = {device.key for device in lab.devices}
    findings = []
    for key, count in Counter(lab.discovered).items():
        if key not in known:
            message = f"discovered: no device {key!r} in the file"
            findings.append(Finding("lab_file.dangling", message, key, {"field": "discovered"}))
        elif count > 1:
            message = f"discovered: {key!r} stands {count} times"
            findings.append(Finding("lab_file.duplicate", message, key, {"field": "discovered"}))
    return findings


def _check_carrier(device: DeviceEntry, mode: LabMode) -> list[Finding]:
    subject = f"devices[{device.key!r}]"
    if (device.transport is None) == (device.simulator is None):
        message = f"{subject}: give exactly one of transport and simulator"
    elif mode is LabMode.SIM and device.simulator is None:
        message = f"{subject}: a lab in mode sim has a simulator for every device"
    elif mode is LabMode.LIVE and device.transport is None:
        message = f"{subject}: a lab in mode live has a transport for every device"
    else:
        return []
    return [Finding("lab_file.carrier", message, device.key, {"field": "transport"})]


def _check_lines(lab: LabFile) -> list[Finding]:
    lines: dict[str, list[DeviceEntry]] = defaultdict(list)
    for device in lab.devices:
        lines[device.line].append(device)
    findings = []
    for line, devices in lines.items():
        if len(devices) == 1:
            continue
        addresses = [device.address for device in devices]
        keys = ", ".join(device.key for device in devices)
        if None in addresses or len(set(addresses)) < len(devices):
            message = f"devices {keys} share line {line!r}: each needs an address of its own"
            findings.append(Finding("lab_file.line_address", message, line, {"field": "address"}))
        if len({device.host_id for device in devices}) > 1:
            message = f"devices {keys} share line {line!r} but not the host"
            findings.append(Finding("lab_file.line_host", message, line, {"field": "host"}))
    return findings


def _check_valve_ports(lab: LabFile) -> list[Finding]:
    valves = {
        resource_id
        for device in lab.devices
        for resource_id in device.nodes.values()
        if resource_id in lab.tree.by_id and lab.tree.by_id[resource_id].kind == "rotary_valve"
    }
    tubes: dict[tuple[UUID, str], set[tuple[UUID, str]]] = defaultdict(set)
    for connection in lab.connections:
        if connection.medium is not Medium.LIQUID:
            continue
        ends = (connection.source, connection.target)
        for own, far in (ends, ends[::-1]):
            if own.resource_id in valves:
                tubes[own.resource_id, own.port].add((far.resource_id, far.port))
    return [
        Finding(
            "lab_file.port_taken",
            f"port {port!r} of valve {lab.tree.by_id[valve].key!r} has {len(far)} tubes; "
            "a port of a rotary valve takes one",
            lab.tree.by_id[valve].key,
            {"field": "port", "port": port},
        )
        for (valve, port), far in tubes.items()
        if len(far) > 1
    ]


def find_amount(amount: float) -> int | None:
    """Return µL in whole nanolitres, or mg in whole micrograms; None is off the grid or zero."""
    return to_nl(amount, 1000) or None
