"""Entities, activities and agents, and what binds them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

Fact = str | int | float | bool


class ProvKind(StrEnum):
    """What PROV has."""

    ENTITY = "entity"
    """A thing in one state: a lot, what a vessel holds, a reading, a plan, a driver's source."""

    ACTIVITY = "activity"
    """What happened over a time: a transaction, a job, a run, a decision."""

    AGENT = "agent"
    """Who or what bears it: a person, a host, a device."""


class Bond(StrEnum):
    """How one node leads to another; named as in PROV-JSON, from the later to the earlier."""

    USED = "used"
    GENERATED = "wasGeneratedBy"
    INVALIDATED = "wasInvalidatedBy"
    DERIVED = "wasDerivedFrom"
    INFORMED = "wasInformedBy"
    ASSOCIATED = "wasAssociatedWith"
    ATTRIBUTED = "wasAttributedTo"
    ON_BEHALF = "actedOnBehalfOf"
    SPECIAL_CASE = "specializationOf"
    MEMBER = "hadMember"


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvNode:
    """One entity, activity or agent."""

    id: str
    """`sort/identity`; unique in a lab."""

    kind: ProvKind
    type: str
    """Our own word for it: `lot`, `state`, `transaction`, …"""

    name: str
    started_at: str = ""
    ended_at: str = ""
    place: str = ""
    """Node at which it was."""

    facts: Mapping[str, Fact] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Relation:
    """One bond between two nodes."""

    bond: Bond
    later: str
    """What came of it, or who acted."""

    earlier: str
    """What it came of, or for whom."""

    role: str = ""
    at: str = ""
    third: str = ""
    """Plan of an association; activity of a delegation."""

    is_revision: bool = False
    facts: Mapping[str, Fact] = field(default_factory=dict)


ENDS: Mapping[Bond, tuple[ProvKind | None, ProvKind | None]] = {
    Bond.USED: (ProvKind.ACTIVITY, ProvKind.ENTITY),
    Bond.GENERATED: (ProvKind.ENTITY, ProvKind.ACTIVITY),
    Bond.INVALIDATED: (ProvKind.ENTITY, ProvKind.ACTIVITY),
    Bond.DERIVED: (ProvKind.ENTITY, ProvKind.ENTITY),
    Bond.INFORMED: (ProvKind.ACTIVITY, ProvKind.ACTIVITY),
    Bond.ASSOCIATED: (ProvKind.ACTIVITY, ProvKind.AGENT),
    Bond.ATTRIBUTED: (ProvKind.ENTITY, ProvKind.AGENT),
    Bond.ON_BEHALF: (ProvKind.AGENT, ProvKind.AGENT),
    Bond.SPECIAL_CASE: (ProvKind.ENTITY, ProvKind.ENTITY),
    Bond.MEMBER: (ProvKind.ENTITY, ProvKind.ENTITY),
}
"""Kinds of the later and of the earlier node of each bond."""

ELSEWHERE = "elsewhere"
"""Stands for the name of what the reader may not know of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvGraph:
    """Nodes by id, and the relations between them; each once."""

    root: str
    nodes: Mapping[str, ProvNode]
    relations: tuple[Relation, ...]


def make_graph(root: str, nodes: Iterable[ProvNode], relations: Iterable[Relation]) -> ProvGraph:
    """Put a graph together, in a stable order.

    Raises:
        ValueError: A relation has an end that is no node, or one of the wrong kind: a mistake
            of whoever built it, never of a person.
    """
    by_id = {node.id: node for node in nodes}
    unique: dict[tuple[object, ...], Relation] = {}
    for relation in relations:
        for end, kind in zip((relation.later, relation.earlier), ENDS[relation.bond], strict=True):
            if end not in by_id or by_id[end].kind is not kind:
                raise ValueError(f"{relation.bond} of {relation.later}: {end} is no {kind}")
        if relation.third and relation.third not in by_id:
            raise ValueError(f"{relation.bond} of {relation.later}: no {relation.third}")
        key = (relation.bond, relation.later, relation.earlier, relation.role, relation.third)
        unique[key] = relation
    ordered = sorted(unique, key=lambda key: tuple(map(str, key)))
    return ProvGraph(
        root=root,
        nodes={name: by_id[name] for name in sorted(by_id)},
        relations=tuple(unique[key] for key in ordered),
    )


def redacted(graph: ProvGraph, hidden: Collection[str]) -> ProvGraph:
    """Return the graph with the names and facts of some nodes taken out; its form stays."""
    secret = frozenset(hidden)
    nodes = {
        name: replace(node, name=ELSEWHERE, facts={}, place="") if name in secret else node
        for name, node in graph.nodes.items()
    }
    return replace(graph, nodes=nodes)
