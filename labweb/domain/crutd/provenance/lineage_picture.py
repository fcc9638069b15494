"""Lineage as a picture: vessels and deliveries in turn with the acts between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from labweb.domain.crutd.provenance.ledger_flows import LedgerFlow, is_nominal, is_reaction


def to_graph(start: str, flows: Sequence[LedgerFlow]) -> dict[str, Any]:
    """Arrange flows as alternating entities and activities.

    Accounts and activities carry their ids only; the caller puts names on them.
    """
    vessels = {start} | {f.source for f in flows} | {f.target for f in flows}
    nodes: list[dict[str, Any]] = [
        {"id": v, "kind": "entity", "type": "vessel"} for v in sorted(vessels) if not is_nominal(v)
    ]
    nodes += [
        {"id": activity, "kind": "activity", "type": "job", "at": at}
        for activity, at in sorted(
            {(f.activity, f.at) for f in flows if is_reaction(f.source) or not is_nominal(f.source)}
        )
    ]
    edges: list[dict[str, Any]] = []
    for flow in flows:
        if is_nominal(flow.source):
            nodes += [
                {"id": f"lot:{lot}", "kind": "entity", "type": "lot"} for lot in sorted(flow.lots)
            ]
            edges += [
                _edge(f"lot:{lot}", flow.target, replace(flow, lots={lot: amount}))
                for lot, amount in flow.lots.items()
            ]
            if is_reaction(flow.source):
                edges += [_edge(flow.activity, f"lot:{lot}", flow) for lot in sorted(flow.lots)]
            continue
        edges.append(_edge(flow.source, flow.activity, flow))
        if not is_nominal(flow.target):
            edges.append(_edge(flow.activity, flow.target, flow))
    unique = {node["id"]: node for node in nodes}
    return {"root": start, "nodes": list(unique.values()), "edges": edges}


def _edge(source: str, target: str, flow: LedgerFlow) -> dict[str, Any]:
    return {
        "source": source,
        "target": target,
        "amount_nl": flow.amount_nl,
        "amount_ug": flow.amount_ug,
        "at": flow.at,
        "label": "",
    }
