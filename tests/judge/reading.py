"""Read graph files of Uni-Lab-OS and of the Chemputer, JSON and GraphML, without the project.

A file with any class of the Chemputer's is a Chemputer graph; every other one is Uni-Lab-OS's.

* Chemputer, ports as pairs `(a,b)`: a **directed** multigraph. An edge lets liquid run from
  source to target; the same two ends drawn both ways are one tube. A flask drawn only towards
  its valve gives and never takes; a waste drawn only from its valve takes and never gives.
  An edge without any port, `(,)`, from a stirrer, heater, chiller, sensor or vacuum pump only says
  what that device acts on.
* Chemputer of 2018, one bare port for each edge: the port is the valve's, 1 edge is a tube, and two
  valves that point at each other are joined by one tube with each one's own port.
* Uni-Lab-OS: **undirected**, as its own loader reads it. Liquid runs on links of type `fluid` or
  `physical` alone. Ports come as a dict by node id, as `(a,b)`, bare, or as source and target
  handle.

Faults of the file as a whole: two nodes of one id, a link to no node, a valve port that the valve
does not have, one valve port with hoses to two devices.
"""

from __future__ import annotations

import gzip
import json
import xml.etree.ElementTree as ET
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tests.judge.kinds import chemputer_device, is_chemputer_class, unilab_device
from tests.judge.rig import Device, DryLink, End, Hose, Kind, Rig

_GRAPHML = "{http://graphml.graphdrawing.org/xmlns}"
_YWORKS = "{http://www.yworks.com/xml/graphml}"
_WET = {"fluid", "physical"}


CHEMPUTER_EDGES_ARE_TUBES = False
"""The other reading of the Chemputer's graphs: every edge carries liquid both ways."""


class NoGraphError(ValueError):
    """The file is no graph with nodes."""


@dataclass(frozen=True)
class RawLink:
    """A link as the file has it; a port is empty when the file names none."""

    source: str
    target: str
    source_port: str = ""
    target_port: str = ""
    medium: str = ""
    bare: str | None = None
    """A single port, not said of which end."""


def read_rig(path: Path, *, are_tubes: bool = CHEMPUTER_EDGES_ARE_TUBES) -> Rig:
    """Return the rig in a file; `.gz` is unpacked.

    `are_tubes` takes every edge of a Chemputer graph as a tube that carries liquid both ways: the
    other reading of those files, for comparison.
    """
    data = path.read_bytes()
    if path.suffix == ".gz":
        data = gzip.decompress(data)
    text = data.decode("utf-8-sig")
    if text.lstrip().startswith("<"):
        return build(*_read_graphml(text), are_tubes=are_tubes)
    return read_json(json.loads(text), are_tubes=are_tubes)


def read_json(document: object, *, are_tubes: bool = CHEMPUTER_EDGES_ARE_TUBES) -> Rig:
    """Return the rig in a node-link document."""
    if not isinstance(document, Mapping) or not isinstance(document.get("nodes"), list):
        raise NoGraphError("no list of nodes")
    nodes = [
        (str(node["id"]), node)
        for node in document["nodes"]
        if isinstance(node, Mapping) and "id" in node
    ]
    links = document.get("links") or []
    raw = [_raw_link(link) for link in links if isinstance(link, Mapping)]
    return build(nodes, raw, are_tubes=are_tubes)


def _raw_link(link: Mapping[str, Any]) -> RawLink:
    source, target = str(link.get("source")), str(link.get("target"))
    raw = RawLink(source, target, medium=str(link.get("type") or ""))
    port = link.get("port")
    if isinstance(port, Mapping):
        named = _name(port.get(source)), _name(port.get(target))
        return replace(raw, source_port=named[0], target_port=named[1])
    if port is None and ("sourceHandle" in link or "targetHandle" in link):
        handles = _name(link.get("sourceHandle")), _name(link.get("targetHandle"))
        return replace(raw, source_port=handles[0], target_port=handles[1])
    return with_port(raw, port)


def with_port(raw: RawLink, port: object) -> RawLink:
    """Return the link with a port written as `(a,b)` or bare."""
    text = _name(port)
    if text.startswith("(") and text.endswith(")") and "," in text:
        first, second = text[1:-1].split(",", 1)
        return replace(raw, source_port=first.strip(), target_port=second.strip())
    return replace(raw, bare=text) if text else raw


def _name(port: object) -> str:
    return "" if port is None else str(port).strip()


def _read_graphml(text: str) -> tuple[list[tuple[str, dict[str, Any]]], list[RawLink]]:
    root = ET.fromstring(text)
    keys = {key.get("id"): key.get("attr.name") for key in root.iter(f"{_GRAPHML}key")}
    ids: dict[str, str] = {}
    nodes = []
    for element in root.iter(f"{_GRAPHML}node"):
        data = _data_of(element, keys)
        label = element.find(f"{_GRAPHML}data//{_YWORKS}NodeLabel")
        shown = (label.text or "").strip() if label is not None else ""
        own = str(element.get("id"))
        ids[own] = shown or own
        nodes.append((ids[own], data))
    links = []
    for edge in root.iter(f"{_GRAPHML}edge"):
        data = _data_of(edge, keys)
        ends = [ids.get(str(edge.get(side)), str(edge.get(side))) for side in ("source", "target")]
        raw = RawLink(ends[0], ends[1], medium=data.get("type") or "")
        links.append(with_port(raw, data.get("port")))
    return nodes, links


def _data_of(element: ET.Element, keys: Mapping[str | None, str | None]) -> dict[str, Any]:
    found = {}
    for data in element.findall(f"{_GRAPHML}data"):
        name = keys.get(data.get("key"))
        if name and data.text and data.text.strip():
            found[name] = data.text.strip()
    return found


def build(
    nodes: Sequence[tuple[str, Mapping[str, Any]]],
    links: list[RawLink],
    *,
    are_tubes: bool = False,
) -> Rig:
    """Return the rig of nodes and links."""
    is_chemputer = any(is_chemputer_class(node.get("class")) for _, node in nodes)
    is_paired = not is_chemputer or not _has_bare_ports(links)
    devices = _devices(nodes, links, is_chemputer=is_chemputer)
    faults = [f"node id {name} is used twice" for name in _twice(name for name, _ in nodes)]
    known = []
    for link in links:
        strange = {link.source, link.target} - devices.keys()
        faults += [f"a link ends at {name}, which is no node" for name in sorted(strange)]
        if not strange:
            known.append(link)
    dry: list[DryLink] = []
    if not is_paired:
        hoses = _tubes_of_2018(known, devices)
    else:
        hoses, dry = _tubes(known, devices, is_chemputer=is_chemputer)
        if are_tubes:
            hoses = [replace(hose, is_backward=True) for hose in hoses]
    devices, hoses = _settle_solenoids(devices, hoses)
    faults += _port_faults(devices, hoses)
    return Rig(devices, tuple(hoses), tuple(dry), tuple(faults))


def _has_bare_ports(links: Iterable[RawLink]) -> bool:
    bare = sum(link.bare is not None for link in links)
    return bare > sum(bool(link.source_port or link.target_port) for link in links)


def _twice(names: Iterable[str]) -> list[str]:
    return [name for name, count in Counter(names).items() if count > 1]


def _devices(
    nodes: Sequence[tuple[str, Mapping[str, Any]]], links: list[RawLink], *, is_chemputer: bool
) -> dict[str, Device]:
    ports: dict[str, set[str]] = defaultdict(set)
    for link in links:
        ports[link.source].add(link.source_port)
        ports[link.target].add(link.target_port)
    if is_chemputer:
        return {name: chemputer_device(name, node) for name, node in nodes}
    return {name: unilab_device(name, node, ports[name] - {""}) for name, node in nodes}


def _tubes(
    links: list[RawLink], devices: Mapping[str, Device], *, is_chemputer: bool
) -> tuple[list[Hose], list[DryLink]]:
    hoses: dict[frozenset[End], Hose] = {}
    dry = []
    for link in links:
        a, b = _ends(link, devices)
        is_wet = link.medium in _WET or (is_chemputer and not link.medium)
        if is_chemputer and _is_attachment(a, b, devices):
            dry.append(DryLink(a, b, "no liquid"))
        elif not is_wet:
            dry.append(DryLink(a, b, link.medium or "nothing stated"))
        elif a[0] != b[0]:
            key = frozenset((a, b))
            old = hoses.get(key)
            if old is None:
                hoses[key] = Hose(a, b, is_forward=True, is_backward=not is_chemputer)
            elif old.a == b:
                hoses[key] = replace(old, is_backward=True)
    return list(hoses.values()), dry


def _is_attachment(a: End, b: End, devices: Mapping[str, Device]) -> bool:
    if a[1] or b[1]:
        return False
    ends = (devices[a[0]], devices[b[0]])
    return any(end.kind is Kind.OTHER and not is_chemputer_class(end.class_name) for end in ends)


def _ends(link: RawLink, devices: Mapping[str, Device]) -> tuple[End, End]:
    a, b = (link.source, link.source_port), (link.target, link.target_port)
    if link.bare is not None:
        selecting = {Kind.VALVE, Kind.PUMP_VALVE}
        if devices[link.source].kind in selecting:
            return (link.source, link.bare), b
        if devices[link.target].kind in selecting:
            return a, (link.target, link.bare)
    return a, b


def _tubes_of_2018(links: list[RawLink], devices: Mapping[str, Device]) -> list[Hose]:
    """Join what one bare port for each edge means; a valve's port is -1 where none is written."""
    own: dict[tuple[str, str], str] = {}
    for link in links:
        if devices[link.source].kind is Kind.VALVE:
            own[(link.source, link.target)] = link.bare or "-1"
        elif devices[link.target].kind is Kind.VALVE:
            own.setdefault((link.target, link.source), link.bare or "-1")
    hoses: dict[frozenset[End], Hose] = {}
    for link in links:
        a = (link.source, own.get((link.source, link.target), ""))
        b = (link.target, own.get((link.target, link.source), ""))
        hoses.setdefault(frozenset((a, b)), Hose(a, b))
    return list(hoses.values())


def _settle_solenoids(
    devices: dict[str, Device], hoses: list[Hose]
) -> tuple[dict[str, Device], list[Hose]]:
    """Give each solenoid two named ends; one with any other number of ends passes nothing."""
    settled = dict(devices)
    for device in devices.values():
        if device.kind is not Kind.SOLENOID:
            continue
        own = [hose for hose in hoses if device.id in {hose.a[0], hose.b[0]}]
        names = {end[1] for hose in own for end in (hose.a, hose.b) if end[0] == device.id}
        if len(own) == 2 and len(names) == 1:
            hoses = [
                _renamed(hose, device.id, str(own.index(hose))) if hose in own else hose
                for hose in hoses
            ]
        elif len(names) != 2 or "" in names:
            settled[device.id] = replace(device, kind=Kind.OTHER)
    return settled, hoses


def _renamed(hose: Hose, device_id: str, port: str) -> Hose:
    if hose.a[0] == device_id:
        return replace(hose, a=(device_id, port))
    return replace(hose, b=(device_id, port))


def _port_faults(devices: Mapping[str, Device], hoses: list[Hose]) -> list[str]:
    faults = []
    peers: dict[End, set[str]] = defaultdict(set)
    for hose in hoses:
        for end in (hose.a, hose.b):
            peers[end].add(hose.other(end)[0])
    for (name, port), others in peers.items():
        device = devices[name]
        if device.kind not in {Kind.VALVE, Kind.PUMP_VALVE}:
            continue
        if not port:
            faults.append(f"a hose of {name} is on no named port")
        elif len(others) > 1:
            faults.append(f"port {port} of {name} has hoses to {' and '.join(sorted(others))}")
        numbered = port.lstrip("-").isdigit()
        if device.declared and numbered and port not in device.declared | {device.common}:
            faults.append(f"{name} has no port {port}")
    return faults
