"""Edges of a workflow: what they connect, that their types agree, and the order they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.workflows.unit_operations.step_palette import (
    STEP_KINDS,
    PortKind,
    StepPort,
    UnitOperation,
)

_FIELDS = ("id", "source", "source_port", "target", "target_port")
_LONGEST = 80


@dataclass(frozen=True, slots=True, kw_only=True)
class Edge:
    """One connection from an output of a step to an input of a later one."""

    id: str
    source: str
    source_port: str
    target: str
    target_port: str

    def to_json(self) -> dict[str, Any]:
        """Render as the file has it."""
        return {name: getattr(self, name) for name in _FIELDS}


def check_edges(
    raw_edges: Sequence[Any], raw_steps: Sequence[Any]
) -> tuple[list[Edge], list[Finding]]:
    """Read edges and list every way in which they do not fit the steps.

    Returns:
        The edges that could be read, and the findings. Subject of a finding is the step
        the edge ends at where there is one, else the edge.
    """
    operations = _operations(raw_steps)
    findings: list[Finding] = []
    edges: list[Edge] = []
    seen: set[str] = set()
    for place, raw in enumerate(raw_edges):
        edge = read_edge(raw, place, findings)
        if edge is None:
            continue
        if edge.id in seen:
            findings.append(
                _finding("protocol.duplicate_id", f"two edges have the id {edge.id!r}", edge.id)
            )
        seen.add(edge.id)
        problems = _check_ends(edge, operations)
        findings += problems
        if not problems:
            edges.append(edge)
    findings += _check_materials(edges, raw_steps, operations)
    cycle = find_cycle(list(operations), edges)
    if cycle:
        text = " → ".join([*cycle, cycle[0]])
        findings.append(
            Finding(
                "protocol.cycle", f"steps wait for each other: {text}", cycle[0], {"field": "edges"}
            )
        )
    return edges, findings


def find_cycle(step_ids: Sequence[str], edges: Sequence[Edge]) -> list[str]:
    """Return the steps of one ring, or an empty list when there is none."""
    following = _following(step_ids, edges)
    order = sort_steps(step_ids, edges)
    stuck = [step_id for step_id in step_ids if step_id not in set(order)]
    if not stuck:
        return []
    # Everything stuck waits, directly or not, for a ring: walk back until a step repeats.
    waits_for = {later: earlier for earlier in stuck for later in following[earlier]}
    path: list[str] = []
    current = stuck[0]
    while current not in path:
        path.append(current)
        current = waits_for[current]
    ring = path[path.index(current) :]
    return ring[::-1]


def sort_steps(step_ids: Sequence[str], edges: Sequence[Edge]) -> list[str]:
    """Order the steps so that each comes after all it waits for; ties as they were drawn.

    Steps of a ring and whatever waits for one are left out.

    Source:
        Kahn, Communications of the ACM 5 (1962) 558-562.
    """
    following = _following(step_ids, edges)
    waiting = dict.fromkeys(step_ids, 0)
    for later in following.values():
        for step_id in later:
            waiting[step_id] += 1
    rank = {step_id: place for place, step_id in enumerate(step_ids)}
    ready = [step_id for step_id in step_ids if not waiting[step_id]]
    order: list[str] = []
    while ready:
        ready.sort(key=rank.__getitem__, reverse=True)
        current = ready.pop()
        order.append(current)
        for step_id in following[current]:
            waiting[step_id] -= 1
            if not waiting[step_id]:
                ready.append(step_id)
    return order


def find_earlier(step_ids: Sequence[str], edges: Sequence[Edge]) -> dict[str, frozenset[str]]:
    """Return, for each step, every step that must be done before it starts."""
    found: dict[str, frozenset[str]] = {step_id: frozenset() for step_id in step_ids}
    direct: dict[str, set[str]] = {step_id: set() for step_id in step_ids}
    for edge in edges:
        direct[edge.target].add(edge.source)
    for step_id in sort_steps(step_ids, edges):
        found[step_id] = frozenset(direct[step_id]).union(*(found[e] for e in direct[step_id]))
    return found


def _following(step_ids: Sequence[str], edges: Sequence[Edge]) -> dict[str, list[str]]:
    following: dict[str, list[str]] = {step_id: [] for step_id in step_ids}
    for edge in edges:
        if edge.source in following and edge.target in following:
            following[edge.source].append(edge.target)
    return {step_id: list(dict.fromkeys(later)) for step_id, later in following.items()}


def _operations(raw_steps: Sequence[Any]) -> dict[str, UnitOperation | None]:
    found: dict[str, UnitOperation | None] = {}
    for raw in raw_steps:
        if isinstance(raw, Mapping) and isinstance(raw.get("id"), str):
            kind = raw.get("kind")
            found[raw["id"]] = STEP_KINDS.get(kind) if isinstance(kind, str) else None
    return found


def _finding(code: str, message: str, subject: str, at: str = "edges") -> Finding:
    return Finding(code, message, subject, {"field": at})


def read_edge(raw: object, place: int, findings: list[Finding]) -> Edge | None:
    """Read one edge and add whatever is wrong with it to `findings`; None: it is no edge."""
    at = f"edges[{place}]"
    if not isinstance(raw, Mapping):
        findings.append(_finding("protocol.not_object", f"edge {place} is no object", "", at))
        return None
    unknown = [str(key)[:_LONGEST] for key in raw if key not in _FIELDS]
    bad = [name for name in _FIELDS if not _is_short_text(raw.get(name))]
    if unknown:
        message = f"edge {place}: {', '.join(unknown[:5])} means nothing here"
        findings.append(_finding("protocol.unknown_field", message, "", at))
    if bad:
        message = f"edge {place}: {', '.join(bad)} must be short text"
        findings.append(_finding("protocol.missing_field", message, "", at))
        return None
    return Edge(**{name: raw[name] for name in _FIELDS})


def _is_short_text(value: object) -> bool:
    return isinstance(value, str) and 0 < len(value) <= _LONGEST


def _check_ends(edge: Edge, operations: Mapping[str, UnitOperation | None]) -> list[Finding]:
    dangling = [end for end in (edge.source, edge.target) if end not in operations]
    if dangling:
        message = f"edge {edge.id} hangs: there is no step {', '.join(map(repr, dangling))}"
        return [_finding("protocol.dangling_edge", message, edge.id)]
    source, target = operations[edge.source], operations[edge.target]
    if source is None or target is None:
        return []  # The unknown kind is a finding of its own; its ports cannot be known.
    out = _port(source.outputs, edge.source_port)
    into = _port(target.inputs, edge.target_port)
    findings = []
    if out is None:
        names = ", ".join(port.name for port in source.outputs)
        message = f"{source.label} has no output {edge.source_port!r}; it has {names}"
        findings.append(_finding("protocol.unknown_port", message, edge.source))
    if into is None:
        names = ", ".join(port.name for port in target.inputs)
        message = f"{target.label} has no input {edge.target_port!r}; it has {names}"
        findings.append(_finding("protocol.unknown_port", message, edge.target))
    if out is not None and into is not None and out.kind is not into.kind:
        message = f"a {out.kind.value} output cannot go into a {into.kind.value} input"
        findings.append(_finding("protocol.port_types", message, edge.target))
    return findings


def _port(ports: Sequence[StepPort], name: str) -> StepPort | None:
    return next((port for port in ports if port.name == name), None)


def _check_materials(
    edges: Sequence[Edge],
    raw_steps: Sequence[Any],
    operations: Mapping[str, UnitOperation | None],
) -> list[Finding]:
    """Refuse a material edge between steps that name two different vessels."""
    params = {
        raw["id"]: raw["params"]
        for raw in raw_steps
        if isinstance(raw, Mapping)
        and isinstance(raw.get("params"), Mapping)
        and "id" in raw
        and isinstance(raw["id"], str)
    }
    findings = []
    fed: dict[tuple[str, str], str] = {}
    for edge in edges:
        if not _is_material(edge, operations):
            continue
        leaves = params.get(edge.source, {}).get(edge.source_port)
        enters = params.get(edge.target, {}).get(edge.target_port)
        if leaves is not None and enters is not None and leaves != enters:
            message = f"edge {edge.id} carries one vessel, but its ends name two"
            findings.append(_finding("protocol.material_mismatch", message, edge.target))
        end = (edge.target, edge.target_port)
        if end in fed:
            message = f"{edge.target_port} takes one material edge; it has {fed[end]} and {edge.id}"
            findings.append(_finding("protocol.material_twice", message, edge.target))
        fed.setdefault(end, edge.id)
    return findings


def _is_material(edge: Edge, operations: Mapping[str, UnitOperation | None]) -> bool:
    operation = operations.get(edge.target)
    port = _port(operation.inputs, edge.target_port) if operation is not None else None
    return port is not None and port.kind is PortKind.MATERIAL
