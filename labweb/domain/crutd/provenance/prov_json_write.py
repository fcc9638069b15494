"""Write a graph as PROV-JSON.

Source:
    The PROV-JSON Serialization, W3C Member Submission of 24 April 2013; names as PROV-N has
    them, W3C Recommendation of 30 April 2013, section 3.7.1.
"""

from __future__ import annotations

import math
from typing import Any

from labweb.domain.crutd.provenance.provenance_graph import (
    Bond,
    Fact,
    ProvGraph,
    ProvKind,
    ProvNode,
    Relation,
)
from labweb.domain.crutd.provenance.qualified_names import escape

VOCABULARY = "urn:x-labweb:ns#"
"""Namespace of our own words."""

_PEOPLE = {"user": "prov:Person", "host": "prov:SoftwareAgent", "plan": "prov:Plan"}

_ENDS: dict[Bond, tuple[str, str]] = {
    Bond.USED: ("activity", "entity"),
    Bond.GENERATED: ("entity", "activity"),
    Bond.INVALIDATED: ("entity", "activity"),
    Bond.DERIVED: ("generatedEntity", "usedEntity"),
    Bond.INFORMED: ("informed", "informant"),
    Bond.ASSOCIATED: ("activity", "agent"),
    Bond.ATTRIBUTED: ("entity", "agent"),
    Bond.ON_BEHALF: ("delegate", "responsible"),
    Bond.SPECIAL_CASE: ("specificEntity", "generalEntity"),
}
_THIRD = {Bond.ASSOCIATED: "plan", Bond.ON_BEHALF: "activity"}
_TIMED = frozenset({Bond.USED, Bond.GENERATED, Bond.INVALIDATED})


def render_prov(graph: ProvGraph, lab_id: str) -> dict[str, Any]:
    """Return a PROV-JSON document of the graph.

    Ids of the lab are names with the prefix `lab`, our own words have the prefix `labweb`.
    Relations have blank names in the order of the graph, so that the same graph always gives
    the same document.

    Args:
        graph: What to write.
        lab_id: Lab in which the ids are unique.
    """
    document: dict[str, Any] = {
        "prefix": {"lab": f"urn:uuid:{lab_id}#", "labweb": VOCABULARY},
    }
    collections = {r.later for r in graph.relations if r.bond is Bond.MEMBER}
    for node in graph.nodes.values():
        record = _node(node, is_collection=node.id in collections)
        document.setdefault(node.kind.value, {})[name_of(node.id)] = record
    for number, relation in enumerate(graph.relations, start=1):
        records = document.setdefault(relation.bond.value, {})
        records[f"_:r{number}"] = _relation(relation)
    return document


def name_of(node_id: str) -> str:
    """Return the qualified name of a node."""
    return f"lab:{escape(node_id)}"


def _node(node: ProvNode, *, is_collection: bool) -> dict[str, Any]:
    record: dict[str, Any] = {"prov:label": node.name}
    types = [_qualified(f"labweb:{escape(node.type)}")]
    if node.type in _PEOPLE:
        types.append(_qualified(_PEOPLE[node.type]))
    if is_collection:
        types.append(_qualified("prov:Collection"))
    record["prov:type"] = types
    if node.kind is ProvKind.ACTIVITY:
        times = {"prov:startTime": node.started_at, "prov:endTime": node.ended_at}
        record |= {key: at for key, at in times.items() if at}
    if node.place:
        record["prov:location"] = _qualified(name_of(node.place))
    return {**record, **_facts(node.facts.items())}


def _relation(relation: Relation) -> dict[str, Any]:
    if relation.bond is Bond.MEMBER:
        return {
            "prov:collection": name_of(relation.later),
            "prov:entity": name_of(relation.earlier),
        }
    later, earlier = _ENDS[relation.bond]
    record: dict[str, Any] = {
        f"prov:{later}": name_of(relation.later),
        f"prov:{earlier}": name_of(relation.earlier),
    }
    if relation.third:
        record[f"prov:{_THIRD[relation.bond]}"] = name_of(relation.third)
    if relation.at and relation.bond in _TIMED:
        record["prov:time"] = relation.at
    if relation.is_revision:
        record["prov:type"] = _qualified("prov:Revision")
    if relation.role:
        record["prov:role"] = _qualified(f"labweb:{escape(relation.role)}")
    return {**record, **_facts(relation.facts.items())}


def _facts(facts: Any) -> dict[str, Any]:  # noqa: ANN401 - items of a mapping
    return {f"labweb:{escape(key) or 'nameless'}": _literal(value) for key, value in facts}


def _literal(value: Fact) -> Any:  # noqa: ANN401 - any JSON
    if isinstance(value, bool):
        return {"$": "true" if value else "false", "type": "xsd:boolean"}
    if isinstance(value, int):
        kind = "xsd:long" if -(2**63) <= value < 2**63 else "xsd:integer"
        return {"$": str(value), "type": kind}
    if isinstance(value, float):
        return {"$": _double(value), "type": "xsd:double"}
    return value


def _double(value: float) -> str:
    if math.isfinite(value):
        return repr(value)
    return "NaN" if math.isnan(value) else "INF" if value > 0 else "-INF"


def _qualified(name: str) -> dict[str, str]:
    return {"$": name, "type": "prov:QUALIFIED_NAME"}
