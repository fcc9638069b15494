"""Nodes and links of a graph file, with every defect listed."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.graph.lab_file.untrusted_json import (
    MAX_FOREIGN_DEPTH,
    MAX_FOREIGN_TEXT,
    MAX_NODES,
    MAX_TEXT,
    decode_json,
    refuse,
    refuse_all,
)

_PORT_ENDS = 2


@dataclass(frozen=True)
class UniLabOsNode:
    """One node as the file has it."""

    key: str
    parent: str | None
    """Key of the parent, by whichever of the file's ways of saying it."""

    raw: Mapping[str, Any]


@dataclass(frozen=True)
class Link:
    """One link as the file has it, its ends as keys."""

    key: str
    source: str
    target: str
    source_port: str
    target_port: str
    raw: Mapping[str, Any]


@dataclass
class UniLabOsGraph:
    """A whole file."""

    nodes: list[UniLabOsNode]
    links: list[Link]
    links_field: str | None
    """`links`, `edges`, or None when the file has neither."""

    top: Mapping[str, Any]
    """Everything of the file beside nodes and links."""

    notes: list[Finding] = field(default_factory=list)
    """Children that nodes list and the file does not hold: their classes make them at run time."""


def read_graph(raw: bytes) -> UniLabOsGraph:
    """Read nodes and links.

    Raises:
        LabFileError: The file is no such graph, or its findings list each duplicate id,
            dangling parent, child or link end, conflict of parents, and ring.
    """
    value = decode_json(raw, MAX_FOREIGN_DEPTH)
    if not isinstance(value, Mapping) or not isinstance(value.get("nodes"), list):
        raise refuse(*_why_no_graph(value))
    links_field = links_field_of(value)
    raw_nodes = value["nodes"]
    raw_links = [] if links_field is None else value[links_field]
    for name, entries in (("nodes", raw_nodes), (str(links_field), raw_links)):
        if not isinstance(entries, list):
            raise refuse("lab_file.shape", f"{name} is no list", name)
        if len(entries) > MAX_NODES:
            message = f"{name} has {len(entries)} entries; at most {MAX_NODES} are read"
            raise refuse("lab_file.too_many", message, name)
    findings: list[Finding] = []
    good = list(_objects("nodes", raw_nodes, findings))
    nodes = _nodes(good, findings)
    links = _links(list(_objects("links", raw_links, findings)), nodes, findings)
    findings += _check_rings(nodes)
    if findings:
        raise refuse_all(findings, "the graph")
    placed = {"nodes", links_field}
    top = {name: part for name, part in value.items() if name not in placed}
    return UniLabOsGraph(nodes, links, links_field, top, _made_later(nodes))


def _made_later(nodes: Iterable[UniLabOsNode]) -> list[Finding]:
    """Note each child that is listed and has no node of its own."""
    nodes = list(nodes)
    known = {node.key for node in nodes}
    return [
        Finding(
            "uni_lab_os.made_later",
            f"{node.key}: its child {child!r} is not in the file: its class makes it at run time, "
            "so nothing is known of it here",
            node.key,
        )
        for node in nodes
        for child in node.raw.get("children") or ()
        if _key(child) not in known
    ]


def _why_no_graph(value: object) -> tuple[str, str, str]:
    if isinstance(value, Mapping) and any(
        isinstance(part, Mapping) and "class" in part for part in value.values()
    ):
        message = (
            "this is the nested form (name → class, children) that came before node-link "
            "graphs; it has neither positions nor links, so no lab can be built from it"
        )
        return "lab_file.nested_form", message, ""
    return "lab_file.no_nodes", 'the file has no list "nodes", so it is no graph of a lab', ""


def links_field_of(value: Mapping[str, Any]) -> str | None:
    """Return the field that holds the links; None: the graph has neither.

    Raises:
        LabFileError: Both hold some, and nobody knows which of them count.
    """
    present = [name for name in ("links", "edges") if name in value]
    if len(present) > 1:
        filled = [name for name in present if value[name]]
        if len(filled) > 1:
            message = "the file has both links and edges; which of them count is unknown"
            raise refuse("lab_file.links_twice", message, "links")
        return filled[0] if filled else "links"
    return present[0] if present else None


def _objects(
    name: str, values: Iterable[object], findings: list[Finding]
) -> Iterable[Mapping[str, Any]]:
    for index, value in enumerate(values):
        if isinstance(value, Mapping):
            yield value
        else:
            subject = f"{name}[{index}]"
            findings.append(Finding("lab_file.shape", f"{subject} is no object", subject))


def _key(value: object) -> str | None:
    """Return an id as text; ids are written as text or as whole numbers."""
    if isinstance(value, str):
        return value or None
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    return None


def _nodes(values: list[Mapping[str, Any]], findings: list[Finding]) -> list[UniLabOsNode]:
    keyed: list[tuple[str, Mapping[str, Any]]] = []
    for index, value in enumerate(values):
        key = _key(value.get("id"))
        if key is None:
            subject = f"nodes[{index}]"
            findings.append(Finding("lab_file.node_id", f"{subject}: id: is missing", subject))
        else:
            keyed.append((key, value))
            findings += _check_fields(key, value)
    counts = Counter(key for key, _ in keyed)
    findings += [
        Finding("tree.duplicate", f"{count} nodes have the id {key!r}", key)
        for key, count in counts.items()
        if count > 1
    ]
    listed = _listed_parents(keyed, set(counts), findings)
    by_uuid = {value["uuid"]: key for key, value in keyed if isinstance(value.get("uuid"), str)}
    nodes = []
    for key, value in keyed:
        parent = _own_parent(key, value, by_uuid, findings)
        lister = listed.get(key)
        if parent is not None and parent not in counts and lister is not None:
            parent = lister  # What it names is made at run time, in the node that lists it.
        if parent is not None and parent not in counts:
            message = f"parent {parent!r} of {key!r} is not in the file"
            findings.append(Finding("tree.dangling_parent", message, key))
        if parent is not None and lister is not None and lister != parent:
            message = f"{key!r} names {parent!r} as its parent, but {lister!r} lists it as a child"
            findings.append(Finding("tree.two_parents", message, key))
        nodes.append(UniLabOsNode(key, parent if parent is not None else lister, value))
    return nodes


def _check_fields(key: str, value: Mapping[str, Any]) -> list[Finding]:
    if len(key) > MAX_FOREIGN_TEXT or len(str(value.get("name") or "")) > MAX_TEXT:
        text = f"nodes[{key[:40]!r}]: id or name is too long"
        return [Finding("lab_file.field", text, key[:40], {"field": "id"})]
    wanted = {"name": str, "config": dict, "data": dict, "children": list, "extra": dict}
    return [
        Finding(
            "lab_file.field",
            f"nodes[{key!r}]: {name}: is no {'text' if sort is str else sort.__name__}",
            key,
            {"field": name},
        )
        for name, sort in wanted.items()
        if value.get(name) is not None and not isinstance(value[name], sort)
    ]


def _listed_parents(
    keyed: list[tuple[str, Mapping[str, Any]]], known: set[str], findings: list[Finding]
) -> dict[str, str]:
    listers: dict[str, list[str]] = defaultdict(list)
    for key, value in keyed:
        children = value.get("children")
        for child in children if isinstance(children, list) else ():
            child_key = _key(child)
            if child_key is None:
                message = f"{key!r} lists the child {child!r}, which is no id"
                findings.append(Finding("tree.dangling_child", message, key))
            elif child_key in known:
                listers[child_key].append(key)
    for child_key, parents in listers.items():
        if len(set(parents)) > 1:
            message = f"{child_key!r} is listed as a child by {', '.join(sorted(set(parents)))}"
            findings.append(Finding("tree.two_parents", message, child_key))
    return {child: parents[0] for child, parents in listers.items()}


def _own_parent(
    key: str, value: Mapping[str, Any], by_uuid: Mapping[str, str], findings: list[Finding]
) -> str | None:
    parent = value.get("parent")
    if parent not in (None, ""):
        found = _key(parent)
        if found is None:
            message = f"nodes[{key!r}]: parent: is no id"
            findings.append(Finding("lab_file.field", message, key, {"field": "parent"}))
        return found
    parent_uuid = value.get("parent_uuid")
    if parent_uuid in (None, ""):
        return None
    if not isinstance(parent_uuid, str) or parent_uuid not in by_uuid:
        message = f"parent_uuid {parent_uuid!r} of {key!r} is not in the file"
        findings.append(Finding("tree.dangling_parent", message, key))
        return None
    return by_uuid[parent_uuid]


def _links(
    values: list[Mapping[str, Any]], nodes: list[UniLabOsNode], findings: list[Finding]
) -> list[Link]:
    known = {node.key for node in nodes}
    links = []
    taken: set[str] = set()
    for index, value in enumerate(values):
        named = _key(value.get("id"))
        subject = named or f"links[{index}]"
        if named is not None and named in taken:
            findings.append(
                Finding("lab_file.duplicate", f"two links have the id {named!r}", named)
            )
        ends = [_key(value.get(end)) for end in ("source", "target")]
        for name, end in zip(("source", "target"), ends, strict=True):
            if end is None or end not in known:
                message = f"link {subject!r}: {name} {value.get(name)!r} is not in the file"
                findings.append(Finding("lab_file.dangling_end", message, subject))
        taken.add(subject)
        source_port, target_port = parse_ports(value)
        if max(len(text) for text in (subject, source_port, target_port)) > MAX_FOREIGN_TEXT:
            message = f"link {subject[:40]!r}: id or port is too long"
            findings.append(Finding("lab_file.field", message, subject[:40], {"field": "id"}))
        links.append(Link(subject, ends[0] or "", ends[1] or "", source_port, target_port, value))
    return links


def parse_ports(link: Mapping[str, Any]) -> tuple[str, str]:
    """Return the port names at source and target; empty where the link names none.

    Source:
        Uni-Lab-OS graphs: `port` keyed by node id, `"(A,B)"` as in Chemputer graphs, or
        one bare name, which is the source's; `sourceHandle` and `targetHandle` elsewhere.
    """
    port = link.get("port")
    if isinstance(port, Mapping):
        source, target = (port.get(str(link.get(end))) for end in ("source", "target"))
        return _port(source), _port(target)
    if port is None:
        return _port(link.get("sourceHandle")), _port(link.get("targetHandle"))
    text = _port(port)
    if text.startswith("(") and text.endswith(")"):
        parts = [part.strip() for part in text[1:-1].split(",")]
        if len(parts) == _PORT_ENDS:
            return parts[0], parts[1]
    return text, ""


def _port(value: object) -> str:
    if isinstance(value, str):
        return value.strip()
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else ""


def _check_rings(nodes: list[UniLabOsNode]) -> list[Finding]:
    parents = {node.key: node.parent for node in nodes}
    settled: set[str] = set()
    findings = []
    for start in parents:
        path: dict[str, None] = {}
        current: str | None = start
        while current is not None and current in parents and current not in settled:
            if current in path:
                ring = list(path)[list(path).index(current) :]
                text = " → ".join([*ring, ring[0]])
                findings.append(Finding("tree.cycle", f"parents form a ring: {text}", ring[0]))
                break
            path[current] = None
            current = parents[current]
        settled.update(path)
    return findings
