"""Read a physical graph, or say everything that is wrong with it."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from labweb.domain.errors import Finding, LabFileError
from labweb.domain.graph.elements import Tube
from labweb.domain.graph.lab_file.uni_lab_os.nodes_and_links import links_field_of, parse_ports
from labweb.domain.graph.lab_file.untrusted_json import (
    MAX_BYTES,
    MAX_NODES,
    decode_json,
    refuse,
    refuse_all,
)
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.rig.graphml import read_graphml
from labweb.domain.graph.rig.lab_as_rig import is_lab, rig_of_lab
from labweb.domain.graph.rig.node_classes import chemputer_sort
from labweb.domain.graph.rig.nodes_as_elements import (
    count_ports,
    element_of,
    find_common_ports,
    find_defects,
    medium_of,
    sort_of,
    volume_nl,
)
from labweb.domain.graph.rig.rig_model import Rig, RigFormat

_GZIP = b"\x1f\x8b"
_GZIP_WINDOW = 31
"""Says to zlib that a gzip head comes first."""


def read_rig(raw: bytes) -> Rig:
    """Read a Chemputer or Uni-Lab-OS graph (JSON, GraphML) or a `lab.json`.

    Args:
        raw: The file, hostile until read.

    Returns:
        The rig. Ids, ports and every other word of the file are kept as they stand, and
        `write_rig` gives them back. A link of a Chemputer graph conducts as it is drawn,
        a link of a Uni-Lab-OS graph both ways. Tubes at ports that do not exist are in
        `defects`.

    Raises:
        LabFileError: Its findings list each duplicate id (`graph.duplicate_id`), link whose
            end is not in the file (`graph.dangling_link`), and node or link that is none;
            or the file is no graph at all.
    """
    if is_graphml(raw):
        document = read_graphml(raw)
        return _build(document.value, RigFormat.GRAPHML, document.text)
    value = decode_json(raw)
    if is_lab(value):
        return rig_of_lab(raw)
    if not isinstance(value, Mapping) or not isinstance(value.get("nodes"), list):
        raise refuse("lab_file.no_nodes", 'the file has no list "nodes", so it is no graph')
    return _build(value, RigFormat.NODE_LINK, None)


def is_graphml(raw: bytes) -> bool:
    """Tell whether a file begins as XML does."""
    return raw.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"<"


def unpacked(raw: bytes) -> bytes:
    """Return a graph, unpacked when it is packed; one byte too many shows that it is too large.

    Raises:
        LabFileError: It is no whole gzip file.
    """
    if not raw.startswith(_GZIP):
        return raw
    message = "the file is no whole gzip file"
    refusal = LabFileError(message, findings=[Finding("lab_file.gzip", message)])
    packed = zlib.decompressobj(wbits=_GZIP_WINDOW)
    try:
        found = packed.decompress(raw, MAX_BYTES + 1)
    except zlib.error as error:
        raise refusal from error
    if packed.unused_data or not (packed.eof or len(found) > MAX_BYTES):
        raise refusal
    return found


def _build(value: Mapping[str, Any], format_: RigFormat, text: str | None) -> Rig:
    links_field = links_field_of(value)
    findings: list[Finding] = []
    nodes = _entries(value.get("nodes"), "nodes", findings)
    links = [] if links_field is None else _entries(value[links_field], links_field, findings)
    keyed = _keyed(nodes, findings)
    known = dict(keyed)
    chemputer = any(chemputer_sort(str(node.get("class") or "")) for node in known.values())
    tubes = _tubes(links, known, findings, chemputer=chemputer)
    if findings:
        raise refuse_all(findings, "the graph")
    elements = find_common_ports([element_of(key, node) for key, node in keyed], tubes)
    elements = count_ports(elements, tubes)
    top = {name: part for name, part in value.items() if name not in ("nodes", links_field)}
    top["links_field"] = links_field
    return Rig(format_, tuple(elements), tuple(tubes), find_defects(elements, tubes), top, text)


def _entries(value: object, name: str, findings: list[Finding]) -> list[Mapping[str, Any]]:
    if not isinstance(value, list):
        raise refuse("lab_file.shape", f"{name} is no list", name)
    if len(value) > MAX_NODES:
        message = f"{name} has {len(value)} entries; at most {MAX_NODES} are read"
        raise refuse("lab_file.too_many", message, name)
    found: list[Mapping[str, Any]] = []
    for place, entry in enumerate(value):
        if isinstance(entry, Mapping):
            found.append(entry)
        else:
            subject = f"{name}[{place}]"
            findings.append(Finding("lab_file.shape", f"{subject} is no object", subject))
    return found


def _key(value: object) -> str | None:
    if isinstance(value, str):
        return value or None
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    return None


def _keyed(
    nodes: list[Mapping[str, Any]], findings: list[Finding]
) -> list[tuple[str, Mapping[str, Any]]]:
    found = []
    for place, node in enumerate(nodes):
        key = _key(node.get("id"))
        if key is None:
            subject = f"nodes[{place}]"
            given = f"its id {node['id']!r:.80} is no text" if node.get("id") else "id is missing"
            findings.append(Finding("lab_file.node_id", f"{subject}: {given}", subject))
        else:
            found.append((key, node))
            findings += [
                Finding("lab_file.field", f"node {key}: {name}: is no object", key, {"field": name})
                for name in ("config", "data")
                if node.get(name) is not None and not isinstance(node[name], Mapping)
            ]
    counts = Counter(key for key, _ in found)
    findings += [
        Finding(
            "graph.duplicate_id",
            f"{count} nodes have the id {key!r}: which of them a link or a request means "
            "cannot be told; give each its own",
            key,
        )
        for key, count in counts.items()
        if count > 1
    ]
    return found


def _tubes(
    links: list[Mapping[str, Any]],
    known: Mapping[str, Mapping[str, Any]],
    findings: list[Finding],
    *,
    chemputer: bool,
) -> list[Tube]:
    tubes: list[Tube] = []
    names: Counter[str] = Counter()
    for place, link in enumerate(links):
        ends = [_key(link.get(end)) for end in ("source", "target")]
        key = _key(link.get("id")) or f"links[{place}]"
        names[key] += 1
        if names[key] > 1:
            key = f"{key}#{names[key]}"
        for name, end in zip(("source", "target"), ends, strict=True):
            if end is None or end not in known:
                message = f"link {key}: its {name} {link.get(name)!r} is not in the file"
                findings.append(Finding("graph.dangling_link", message, key))
        source, target = ends
        if source in known and target in known and source is not None and target is not None:
            nodes = (known[source], known[target])
            tubes.append(_tube(key, (source, target), link, nodes, chemputer=chemputer))
    return _with_far_ports(tubes)


def _tube(
    key: str,
    ends: tuple[str, str],
    link: Mapping[str, Any],
    nodes: tuple[Mapping[str, Any], Mapping[str, Any]],
    *,
    chemputer: bool,
) -> Tube:
    sorts = (sort_of(nodes[0]), sort_of(nodes[1]))
    source_port, target_port = parse_ports(link)
    one_ended = _is_one_ended(link)
    if one_ended:
        # One number is the valve's: of the only valve, or of the one that the link leaves.
        valve_at_target = sorts[1].role.value == "valve" and sorts[0].role.value != "valve"
        source_port, target_port = ("", source_port) if valve_at_target else (source_port, "")
        if sorts[0].role.value != "valve":
            source_port = ""
    medium = medium_of(link, sorts, chemputer=chemputer)
    drawn_as_flows = chemputer and link.get("type") in (None, "") and not one_ended
    return Tube(
        key=key,
        source=ends[0],
        source_port=source_port,
        target=ends[1],
        target_port=target_port,
        medium=medium,
        is_two_way=not drawn_as_flows,
        dead_volume_nl=volume_nl(link.get("volume")) if chemputer else None,
        attributes=link,
    )


def _is_one_ended(link: Mapping[str, Any]) -> bool:
    """Tell whether a link names one port for both ends, as rigs of 2018 do."""
    port = link.get("port")
    if isinstance(port, bool) or not isinstance(port, str | int):
        return False
    text = str(port).strip()
    return bool(text) and not text.startswith("(")


def _with_far_ports(tubes: list[Tube]) -> list[Tube]:
    """Join two links between the same valves, each naming its own port, to one tube each way."""
    own = {
        (tube.source, tube.target): tube.source_port
        for tube in tubes
        if tube.medium is Medium.LIQUID and tube.source_port and not tube.target_port
    }
    result = []
    for tube in tubes:
        far = own.get((tube.target, tube.source))
        if far is not None and own.get((tube.source, tube.target)) == tube.source_port:
            tube = replace(tube, target_port=far)  # noqa: PLW2901
        result.append(tube)
    return result
