"""Ledgers to ask for lineage: written by hand, or random and kept by a book of marks."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from labweb.domain.crutd.provenance.ledger_flows import LedgerFlow
from labweb.domain.crutd.provenance.lineage import History, Page
from labweb.domain.resources.contents_by_lot import LotId, take

Link = tuple[int, str]
"""Order of a flow, and a lot in it."""


def flow(order: int, source: str, target: str, *, activity: str = "", **lots: int) -> LedgerFlow:
    return a_flow(order, source, target, lots, activity=activity)


def a_flow(
    order: int, source: str, target: str, lots: Mapping[Any, int], *, activity: str = ""
) -> LedgerFlow:
    return LedgerFlow(
        order=order,
        activity=activity or f"t{order}",
        source=source,
        target=target,
        at=f"2026-01-01T00:00:{order % 60:02}Z",
        lots=dict(lots),
    )


def reader(flows: Sequence[LedgerFlow], unread: Collection[str] = ()) -> History:
    """Answer as the database does, and refuse to be asked twice for the same account."""
    asked: set[str] = set()

    def history(accounts: Collection[str]) -> Page:
        assert not asked & set(accounts), "each account is read once"
        asked.update(accounts)
        wanted = set(accounts) - set(unread)
        return Page(
            [f for f in flows if f.source in wanted or f.target in wanted],
            frozenset(unread) & frozenset(accounts),
        )

    return history


def links(flows: Sequence[LedgerFlow]) -> set[Link]:
    return {(f.order, lot) for f in flows for lot in f.lots}


@dataclass
class Book:
    """A lab where every pool carries the marks of all flows that its matter went through.

    Marks go forward with the matter and vanish with the last drop: nothing here looks back.
    """

    flows: list[LedgerFlow] = field(default_factory=list)
    held: dict[str, dict[LotId, int]] = field(default_factory=dict)
    marks: dict[tuple[str, str], set[Link]] = field(default_factory=dict)
    last_marks: dict[str, set[Link]] = field(default_factory=dict)
    """By vessel: the marks of what it holds, or held before its last drop went."""

    tainted: dict[str, set[tuple[str, str]]] = field(default_factory=dict)
    """By vessel: the pools in which something of it is."""

    touched: dict[str, set[Link]] = field(default_factory=dict)
    """By vessel: the flows that carried something of it."""

    def deliver(self, vessel: str, lot: str, amount: int) -> None:
        self._write("RECEIPT", vessel, {LotId(lot): amount})

    def pour(self, source: str, target: str, amount: int) -> None:
        total = sum(self.held.get(source, {}).values())
        if source == target or not total:
            return
        self._write(source, target, dict(take(self.held[source], min(amount, total))))

    def _write(self, source: str, target: str, parts: dict[LotId, int]) -> None:
        order = len(self.flows) + 1
        self.flows.append(a_flow(order, source, target, parts))
        for lot, amount in parts.items():
            carried = set(self.marks.get((source, lot), set())) | {(order, lot)}
            self._taint(source, target, lot, order)
            held = self.held.setdefault(target, {})
            held[lot] = held.get(lot, 0) + amount
            self.marks.setdefault((target, lot), set()).update(carried)
        self._remember(target)
        if source in self.held:
            self._remember(source)
            self._draw(source, parts)

    def _draw(self, source: str, parts: dict[LotId, int]) -> None:
        for lot, amount in parts.items():
            self.held[source][lot] -= amount
            if not self.held[source][lot]:
                del self.held[source][lot]
                self.marks.pop((source, lot), None)
                for pools in self.tainted.values():
                    pools.discard((source, lot))
        if self.held[source]:
            self._remember(source)

    def _remember(self, vessel: str) -> None:
        pools = [self.marks.get((vessel, lot), set()) for lot in self.held.get(vessel, {})]
        self.last_marks[vessel] = set().union(*pools)

    def _taint(self, source: str, target: str, lot: str, order: int) -> None:
        if source not in self.held:
            return
        for origin in self.held:
            pools = self.tainted.setdefault(origin, set())
            if origin == source or (source, lot) in pools:
                pools.add((target, lot))
                self.touched.setdefault(origin, set()).add((order, lot))
