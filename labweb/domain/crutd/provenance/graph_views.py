"""The graph for people and for programs: rows, plain data, and a drawing for Graphviz."""

from __future__ import annotations

from typing import Any

from labweb.domain.crutd.provenance.provenance_graph import Bond, ProvGraph, ProvKind, Relation

HEADS = ("kind", "type", "name", "from", "to", "id")

_FORMS = {ProvKind.ENTITY: "ellipse", ProvKind.ACTIVITY: "box", ProvKind.AGENT: "house"}


def to_rows(graph: ProvGraph) -> list[tuple[str, ...]]:
    """Return one row for each node, activities by time, then the others by sort and name."""
    nodes = sorted(
        graph.nodes.values(),
        key=lambda n: (n.kind is not ProvKind.ACTIVITY, n.started_at, n.kind, n.type, n.name, n.id),
    )
    return [(n.kind.value, n.type, n.name, n.started_at, n.ended_at, n.id) for n in nodes]


def to_json(graph: ProvGraph) -> dict[str, Any]:
    """Return the graph as plain data."""
    return {
        "root": graph.root,
        "nodes": [
            {
                "id": node.id,
                "kind": node.kind.value,
                "type": node.type,
                "name": node.name,
                "started_at": node.started_at or None,
                "ended_at": node.ended_at or None,
                "place": node.place or None,
                "facts": dict(node.facts),
            }
            for node in graph.nodes.values()
        ],
        "relations": [_relation(relation) for relation in graph.relations],
    }


def _relation(relation: Relation) -> dict[str, Any]:
    return {
        "bond": relation.bond.value,
        "later": relation.later,
        "earlier": relation.earlier,
        "role": relation.role,
        "at": relation.at or None,
        "third": relation.third or None,
        "is_revision": relation.is_revision,
        "facts": dict(relation.facts),
    }


def to_dot(graph: ProvGraph) -> str:
    """Return the graph in the language of Graphviz; matter flows from left to right."""
    lines = ["digraph provenance {", "  rankdir=RL;"]
    for node in graph.nodes.values():
        thick = ", penwidth=2" if node.id == graph.root else ""
        label = f"{node.type}\n{node.name}"
        lines.append(
            f"  {_quoted(node.id)} [shape={_FORMS[node.kind]}, label={_quoted(label)}{thick}];"
        )
    for relation in graph.relations:
        label = relation.bond.value + (f" ({relation.role})" if relation.role else "")
        style = ", style=dashed" if relation.bond is Bond.SPECIAL_CASE else ""
        ends = f"{_quoted(relation.later)} -> {_quoted(relation.earlier)}"
        lines.append(f"  {ends} [label={_quoted(label)}{style}];")
    return "\n".join([*lines, "}", ""])


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\r", "")
    return '"' + escaped.replace("\n", "\\n") + '"'
