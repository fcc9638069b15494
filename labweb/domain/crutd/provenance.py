"""Where matter came from and where it went, from posted double entries."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Flow:
    """One transfer as the ledger has it: all lots of one transaction between two accounts."""

    order: int
    """Place in the ledger; later is larger."""

    activity: str
    """Transaction that moved it."""

    source: str
    target: str
    amount_nl: int
    at: str
    lots: Mapping[str, int]


Step = Callable[[Mapping[str, int]], Sequence[Flow]]
"""Given accounts with a bound on the order, return the flows beyond them."""


def is_nominal(account: str) -> bool:
    """Tell whether an account is no vessel: RECEIPT, WASTE, LOSS."""
    return "-" not in account


def walk(start: str, step: Step, *, forward: bool, depth: int) -> tuple[list[Flow], int]:
    """Follow matter from a vessel, backwards or forwards in time, `depth` transfers far.

    A flow counts only when it happened before (backwards) or after (forwards) the one
    that led to its vessel, so that what was poured in later is no ancestor. A delivery
    counts as no step of its own: where the trail reaches a vessel, its lots are named.

    Returns:
        The flows in ledger order, and how many lie just beyond the depth.
    """
    bounds: dict[str, int] = {start: 0 if forward else 2**62}
    found: dict[tuple[str, str, str], Flow] = {}
    for _ in range(depth):
        flows = [f for f in step(bounds) if (f.activity, f.source, f.target) not in found]
        if not flows:
            return _ordered(found), 0
        found.update({(f.activity, f.source, f.target): f for f in flows})
        bounds = _next_bounds(flows, forward=forward)
    beyond = [f for f in step(bounds) if (f.activity, f.source, f.target) not in found]
    receipts = [flow for flow in beyond if is_nominal(flow.source)]
    found.update({(f.activity, f.source, f.target): f for f in receipts})
    return _ordered(found), len(beyond) - len(receipts)


def _ordered(found: Mapping[tuple[str, str, str], Flow]) -> list[Flow]:
    return sorted(found.values(), key=lambda flow: flow.order)


def _next_bounds(flows: Sequence[Flow], *, forward: bool) -> dict[str, int]:
    bounds: dict[str, int] = {}
    for flow in flows:
        account = flow.target if forward else flow.source
        if is_nominal(account):
            continue
        best = min if forward else max
        bounds[account] = best(bounds.get(account, flow.order), flow.order)
    return bounds


def to_graph(start: str, flows: Sequence[Flow]) -> dict[str, Any]:
    """Arrange flows as alternating entities and activities.

    Accounts and activities carry their ids only; the caller puts names on them.
    """
    vessels = {start} | {f.source for f in flows} | {f.target for f in flows}
    nodes: list[dict[str, Any]] = [
        {"id": v, "kind": "entity", "type": "vessel"} for v in sorted(vessels) if not is_nominal(v)
    ]
    nodes += [
        {"id": activity, "kind": "activity", "type": "job", "at": at}
        for activity, at in sorted({(f.activity, f.at) for f in flows if not is_nominal(f.source)})
    ]
    edges: list[dict[str, Any]] = []
    for flow in flows:
        if is_nominal(flow.source):
            nodes += [
                {"id": f"lot:{lot}", "kind": "entity", "type": "lot"} for lot in sorted(flow.lots)
            ]
            edges += [_edge(f"lot:{lot}", flow.target, n, flow.at) for lot, n in flow.lots.items()]
            continue
        edges.append(_edge(flow.source, flow.activity, flow.amount_nl, flow.at))
        edges.append(_edge(flow.activity, flow.target, flow.amount_nl, flow.at))
    unique = {node["id"]: node for node in nodes}
    return {"root": start, "nodes": list(unique.values()), "edges": edges}


def _edge(source: str, target: str, amount_nl: int, at: str) -> dict[str, Any]:
    return {"source": source, "target": target, "amount_nl": amount_nl, "at": at, "label": ""}
