"""Follow matter through the ledger, lot by lot, as far as it was really there.

A vessel is well mixed: what leaves it holds of every delivery that came in since the lot was
last used up there, and of none before. So water that went through a syringe last week is no
ancestor of the acid that goes through it now.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace

from labweb.domain.crutd.provenance.ledger_flows import LedgerFlow, is_nominal, is_reaction

FOREVER = 2**62
"""Later than every flow."""


@dataclass(frozen=True, slots=True)
class Page:
    """What the ledger says of some accounts."""

    flows: Sequence[LedgerFlow]
    """Every flow into and out of them, in ledger order."""

    unread: frozenset[str] = frozenset()
    """Accounts with more flows than may be read; of these `ledger_flows` holds none."""


History = Callable[[Collection[str]], Page]


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """How far a walk may go."""

    depth: int
    """Transfers from one end to the other."""

    size: int
    """Flows in all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """The flows found, and what was left out."""

    flows: tuple[LedgerFlow, ...] = ()
    """In ledger order; each holds the lots that matter here, and no others."""

    beyond: int = 0
    """Flows that lie just behind the depth or the size."""

    unread: frozenset[str] = frozenset()
    """Vessels behind which nothing was read, for they have too long a history."""

    spans: tuple[Span, ...] = ()
    """When the matter was in which vessel."""

    @property
    def is_whole(self) -> bool:
        """Tell whether nothing was left out."""
        return not self.beyond and not self.unread


@dataclass(frozen=True, slots=True)
class Span:
    """A stay of the matter in a vessel, by the transactions that began and ended it."""

    vessel: str
    first: str | None
    """None: it goes back beyond what was read."""

    last: str | None
    """None: it lasts."""


@dataclass(frozen=True, slots=True)
class _Pool:
    """A lot in a vessel, just before (or from) a place in the ledger."""

    vessel: str
    lot: str
    order: int
    activity: str | None


class _Ledger:
    """What was read so far; each account once."""

    def __init__(self, history: History) -> None:
        self._history = history
        self._known: set[str] = set()
        self.unread: set[str] = set()
        self._flows: dict[tuple[str, str, str], LedgerFlow] = {}
        self._by_pool: dict[tuple[str, str], list[tuple[LedgerFlow, int]]] = {}
        self._by_activity: dict[str, list[LedgerFlow]] = {}

    def read(self, accounts: Iterable[str]) -> None:
        wanted = {a for a in accounts if not is_nominal(a)} - self._known
        if not wanted:
            return
        page = self._history(sorted(wanted))
        self._known |= wanted
        self.unread |= page.unread
        for flow in page.flows:
            if flow.key not in self._flows:
                self._flows[flow.key] = flow
                self._by_activity.setdefault(flow.activity, []).append(flow)
            for account, sign in ((flow.source, -1), (flow.target, 1)):
                if account in wanted:
                    for lot, amount in flow.lots.items():
                        self._by_pool.setdefault((account, lot), []).append((flow, sign * amount))

    def lots_of(self, vessel: str) -> list[str]:
        return [lot for account, lot in self._by_pool if account == vessel]

    def rows(self, vessel: str, lot: str) -> list[tuple[LedgerFlow, int]]:
        return self._by_pool.get((vessel, lot), [])

    def siblings(self, flow: LedgerFlow) -> list[LedgerFlow]:
        return self._by_activity.get(flow.activity, [])


def trace_up(vessel: str, history: History, limits: Limits) -> Trace:
    """Find what led to what a vessel holds, or held last when it is empty.

    A delivery counts as no step of its own: where the trail reaches a vessel, its lots are named.

    Effect:
        None. `history` is asked once for each account.
    """
    ledger = _Ledger(history)
    ledger.read([vessel])
    return _trace(_last_held(ledger, vessel), ledger, limits, forward=False)


def trace_down(vessel: str, history: History, limits: Limits) -> Trace:
    """Find all that became of what was ever in a vessel."""
    ledger = _Ledger(history)
    ledger.read([vessel])
    pools = [_Pool(vessel, lot, -1, None) for lot in ledger.lots_of(vessel)]
    return _trace(pools, ledger, limits, forward=True, root=vessel)


def trace_flows(
    flows: Sequence[LedgerFlow], history: History, limits: Limits, *, forward: bool
) -> Trace:
    """Follow given flows on, from their targets or back from their sources; they are included."""
    ledger = _Ledger(history)
    links = [(flow, lot) for flow in flows for lot in flow.lots]
    pools = [_pool_of(flow, lot, forward=forward) for flow, lot in links]
    given = {(flow.key, lot): flow for flow, lot in links}
    kept = [pool for pool in pools if pool is not None]
    return _trace(kept, ledger, limits, forward=forward, given=given)


def _last_held(ledger: _Ledger, vessel: str) -> list[_Pool]:
    """Return the pools of a vessel now; when it is empty, as they were before they went."""
    held: list[_Pool] = []
    gone: list[_Pool] = []
    for lot in ledger.lots_of(vessel):
        rows = ledger.rows(vessel, lot)
        if sum(amount for _, amount in rows) > 0:
            held.append(_Pool(vessel, lot, FOREVER, None))
        else:
            last = next((flow for flow, amount in reversed(rows) if amount < 0), None)
            if last is not None:
                gone.append(_Pool(vessel, lot, last.order, last.activity))
    if held or not gone:
        return held
    newest = max(pool.order for pool in gone)
    act = next(pool.activity for pool in gone if pool.order == newest)
    return [pool for pool in gone if pool.activity == act]


_Links = dict[tuple[tuple[str, str, str], str], LedgerFlow]


def _trace(
    pools: Sequence[_Pool],
    ledger: _Ledger,
    limits: Limits,
    *,
    forward: bool,
    root: str = "",
    given: _Links | None = None,
) -> Trace:
    found: _Links = dict(given or {})
    spans: set[Span] = set()
    beyond = 0
    for level in range(limits.depth + 1):
        ledger.read(pool.vessel for pool in pools)
        links = _next(pools, ledger, spans, forward=forward, root=root)
        fresh = {key: flow for key, flow in links.items() if key not in found}
        if level == limits.depth:
            receipts = {k: f for k, f in fresh.items() if not forward and is_nominal(f.source)}
            found |= receipts
            beyond += len({key for key, _ in fresh.keys() - receipts.keys()})
            break
        kept = _within(fresh, limits.size - len({key for key, _ in found}))
        beyond += len({key for key, _ in fresh} - {key for key, _ in kept})
        found |= kept
        pools = [
            pool
            for (_, lot), flow in kept.items()
            if (pool := _pool_of(flow, lot, forward=forward))
        ]
        if not pools:
            break
    return Trace(
        flows=_trimmed(found),
        beyond=beyond,
        unread=frozenset(ledger.unread),
        spans=tuple(sorted(spans, key=str)),
    )


def _next(
    pools: Sequence[_Pool], ledger: _Ledger, spans: set[Span], *, forward: bool, root: str
) -> _Links:
    """Return the flows that fed the pools, or that the pools fed."""
    links: _Links = {}
    for pool in pools:
        rows = ledger.rows(pool.vessel, pool.lot)
        if forward:
            is_all = pool.vessel == root and pool.order < 0
            linked, last = _outflows(rows, pool.order, is_all=is_all)
            spans.add(Span(pool.vessel, pool.activity, last))
        else:
            linked = _inflows(rows, pool.order)
            first = linked[0].activity if linked else None
            spans.add(Span(pool.vessel, first, pool.activity))
        for flow in linked:
            links[flow.key, pool.lot] = flow
            links.update(_reacted(flow, ledger, forward=forward))
    return links


def _inflows(rows: Sequence[tuple[LedgerFlow, int]], before: int) -> list[LedgerFlow]:
    """Return what came in since the lot was last used up, before a place in the ledger."""
    balance, since = 0, []
    for flow, amount in rows:
        if flow.order >= before:
            break
        balance += amount
        if amount > 0:
            since.append(flow)
        elif balance <= 0:
            since = []
    return since


def _outflows(
    rows: Sequence[tuple[LedgerFlow, int]], after: int, *, is_all: bool
) -> tuple[list[LedgerFlow], str | None]:
    """Return what went out from a place in the ledger on, and the act that used the lot up."""
    balance, since = 0, []
    for flow, amount in rows:
        balance += amount
        if flow.order > after and amount < 0:
            since.append(flow)
            if balance <= 0 and not is_all:
                return since, flow.activity
    return since, None


def _reacted(flow: LedgerFlow, ledger: _Ledger, *, forward: bool) -> _Links:
    """Return the other side of a reaction: reactants of a product, products of a reactant."""
    if forward and is_reaction(flow.target):
        others = [f for f in ledger.siblings(flow) if is_reaction(f.source)]
    elif not forward and is_reaction(flow.source):
        others = [f for f in ledger.siblings(flow) if is_reaction(f.target)]
    else:
        return {}
    return {(other.key, lot): other for other in others for lot in other.lots}


def _pool_of(flow: LedgerFlow, lot: str, *, forward: bool) -> _Pool | None:
    vessel = flow.target if forward else flow.source
    return None if is_nominal(vessel) else _Pool(vessel, lot, flow.order, flow.activity)


def _within(fresh: _Links, room: int) -> _Links:
    """Keep whole flows, in ledger order, as long as there is room."""
    order = sorted({(flow.order, flow.key) for flow in fresh.values()})
    kept = {key for _, key in order[: max(room, 0)]}
    return {link: flow for link, flow in fresh.items() if link[0] in kept}


def _trimmed(found: _Links) -> tuple[LedgerFlow, ...]:
    lots: dict[tuple[str, str, str], dict[str, int]] = {}
    flows: dict[tuple[str, str, str], LedgerFlow] = {}
    for (key, lot), flow in found.items():
        flows[key] = flow
        lots.setdefault(key, {})[lot] = flow.lots[lot]
    trimmed = [replace(flow, lots=dict(sorted(lots[key].items()))) for key, flow in flows.items()]
    return tuple(sorted(trimmed, key=lambda flow: (flow.order, flow.key)))
