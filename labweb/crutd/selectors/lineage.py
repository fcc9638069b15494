"""Lineage of what vessels hold, from the ledger."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from datetime import datetime
from typing import Any
from uuid import UUID

from django.db import connection
from django.db.models import Count

from labweb.crutd.models import Entry, Transaction
from labweb.domain.crutd.provenance.ledger_flows import REACTION, LedgerFlow, is_reaction
from labweb.domain.crutd.provenance.lineage import (
    History,
    Limits,
    Page,
    Trace,
    trace_down,
    trace_up,
)
from labweb.domain.crutd.provenance.lineage_picture import to_graph
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Resource

DEEPEST = 100
"""Transfers that a walk may go."""

MOST_FLOWS = 2000
"""Flows that a walk may find."""

_MOST_ENTRIES = 20_000
"""Ledger rows that one step of a walk may read."""

_COLUMNS = [field.name for field in Entry._meta.concrete_fields]  # noqa: SLF001 - Django's own API
_AMOUNTS = sorted(
    (name for name in _COLUMNS if name.startswith("amount_")), key=lambda name: name[-2:] == "ug"
)
"""Columns of an amount, one for each unit, masses last; all but one of a row are zero."""

_FIELDS = ("id", "transaction_id", "debit", "credit", "lot_id", "at", *_AMOUNTS)
_FIRST_UG = next(place for place, name in enumerate(_FIELDS) if name.endswith("_ug"))

# Written out, for a walk asks it once for each step, and the ORM would take longer than the
# database. The names are those of columns.
_HISTORY = f"""
SELECT {", ".join(_FIELDS)} FROM crutd_entry WHERE state = 'posted' AND debit = ANY(%s)
UNION
SELECT {", ".join(_FIELDS)} FROM crutd_entry WHERE state = 'posted' AND credit = ANY(%s)
ORDER BY id LIMIT %s
"""  # noqa: S608


# Where the lots of a vessel came through: one query in place of one for each step of a walk.
_CAME_THROUGH = """
WITH RECURSIVE up(account, lot_id) AS (
    SELECT %s::varchar, lot_id FROM crutd_holding
    WHERE resource_id = %s AND (amount_nl > 0 OR amount_ug > 0)
    UNION
    SELECT e.debit, e.lot_id FROM up CROSS JOIN LATERAL (
        SELECT debit, lot_id FROM crutd_entry
        WHERE credit = up.account AND lot_id = up.lot_id AND state = 'posted' AND debit LIKE %s
        OFFSET 0
    ) e
)
SELECT account, lot_id FROM up LIMIT %s
"""

_MOST_AHEAD = 500
"""Lots in vessels that are read before a walk asks for them."""

_AHEAD = f"""
SELECT {", ".join(_FIELDS)} FROM crutd_entry
WHERE state = 'posted' AND debit = ANY(%s) AND (lot_id = ANY(%s) OR debit = %s OR credit LIKE %s)
UNION
SELECT {", ".join(_FIELDS)} FROM crutd_entry
WHERE state = 'posted' AND credit = ANY(%s) AND (lot_id = ANY(%s) OR credit = %s OR debit LIKE %s)
ORDER BY id LIMIT %s
"""  # noqa: S608


def _read_ahead(vessel: UUID) -> History:
    """Return a history that has read what a walk up from a vessel will ask for.

    Of the vessels on the way only the lots that the walk follows are read; of the first one
    all. A reaction makes one lot of others: where there is one, and for vessels and lots
    beyond a bound, each step reads for itself.
    """
    start = str(vessel)
    with connection.cursor() as cursor:
        cursor.execute(_CAME_THROUGH, [start, vessel, "%-%", _MOST_AHEAD + 1])
        ahead = cursor.fetchall()
        accounts = sorted({row[0] for row in ahead})
        lots = sorted({row[1] for row in ahead})
        side: list[Any] = [accounts, lots, start]
        reaction = f"{REACTION}%"
        cursor.execute(_AHEAD, [*side, reaction, *side, reaction, _MOST_ENTRIES + 1])
        rows = cursor.fetchall()
    flows = _flows(rows)
    has_reaction = any(is_reaction(end) for flow in flows for end in (flow.source, flow.target))
    if not ahead or has_reaction or len(ahead) > _MOST_AHEAD or len(rows) > _MOST_ENTRIES:
        return history
    known: dict[str, list[LedgerFlow]] = {account: [] for account in accounts}
    for flow in flows:
        for account in {flow.source, flow.target} & known.keys():
            known[account].append(flow)

    def read(wanted: Collection[str]) -> Page:
        if not known.keys() >= set(wanted):
            return history(wanted)
        found = {flow.key: flow for account in wanted for flow in known[account]}
        return Page(sorted(found.values(), key=lambda flow: flow.order))

    return read


def history(accounts: Collection[str]) -> Page:
    """Return every posted flow into and out of the accounts; one query when they are few.

    Accounts with the longest histories are left out, and named, until the rest can be read.
    """
    wanted = list(accounts)
    rows = _entries(wanted)
    if len(rows) <= _MOST_ENTRIES:
        return Page(_flows(rows))
    short = _short_enough(wanted)
    return Page(_flows(_entries(short)), frozenset(wanted) - frozenset(short))


def _entries(accounts: list[str]) -> list[tuple[Any, ...]]:
    with connection.cursor() as cursor:
        cursor.execute(_HISTORY, [accounts, accounts, _MOST_ENTRIES + 1])
        return list(cursor.fetchall())


def _short_enough(accounts: Sequence[str]) -> list[str]:
    counts = dict.fromkeys(accounts, 0)
    posted = Entry.objects.filter(state=Entry.State.POSTED)
    for side in ("debit", "credit"):
        found = posted.filter(**{f"{side}__in": accounts}).values_list(side).annotate(Count("id"))
        for account, count in found:
            counts[account] += count
    kept: list[str] = []
    room = _MOST_ENTRIES
    for account in sorted(accounts, key=lambda a: (counts[a], a)):
        room -= counts[account]
        if room < 0:
            break
        kept.append(account)
    return kept


def receipts_of(lot_id: UUID) -> list[LedgerFlow]:
    """Return the flows that brought a lot into the lab."""
    rows = Entry.objects.filter(lot_id=lot_id, state=Entry.State.POSTED)
    nominal = rows.exclude(debit__contains="-").order_by("id")
    return _flows(list(nominal.values_list(*_FIELDS)[:MOST_FLOWS]))


def flows_of(transaction_ids: Iterable[UUID]) -> list[LedgerFlow]:
    """Return the flows that transactions posted; one query."""
    rows = Entry.objects.filter(transaction_id__in=list(transaction_ids))
    posted = rows.filter(state=Entry.State.POSTED).order_by("id")
    return _flows(list(posted.values_list(*_FIELDS)))


def _flows(rows: Sequence[tuple[Any, ...]]) -> list[LedgerFlow]:
    grouped: dict[tuple[str, str, str], list[tuple[Any, ...]]] = {}
    for row in rows:
        grouped.setdefault((str(row[1]), row[2], row[3]), []).append(row)
    return [
        LedgerFlow(
            order=entries[0][0],
            activity=activity,
            source=debit,
            target=credit,
            at=entries[0][5].isoformat(),
            lots={str(entry[4]): sum(entry[6:]) for entry in entries},
            in_ug=frozenset(str(entry[4]) for entry in entries if any(entry[_FIRST_UG:])),
        )
        for (activity, debit, credit), entries in grouped.items()
    ]


def traces(resource: Resource, *, direction: str, limits: Limits) -> list[Trace]:
    """Follow what a vessel holds up, what was in it down, or both."""
    start = str(resource.id)
    found = []
    if direction in {"up", "both"}:
        found.append(trace_up(start, _read_ahead(resource.id), limits))
    if direction in {"down", "both"}:
        found.append(trace_down(start, history, limits))
    return found


def traces_until(vessels: Iterable[UUID], until: datetime, limits: Limits) -> list[Trace]:
    """Follow what vessels held just after a moment up."""

    def before(accounts: Collection[str]) -> Page:
        page = history(accounts)
        kept = [flow for flow in page.flows if datetime.fromisoformat(flow.at) <= until]
        return Page(kept, page.unread)

    return [trace_up(str(vessel), before, limits) for vessel in vessels]


def lineage(resource: Resource, *, direction: str, depth: int) -> dict[str, Any]:
    """Return the graph of what led to a vessel's contents and what became of them."""
    found = traces(resource, direction=direction, limits=Limits(depth=depth, size=MOST_FLOWS))
    flows = {flow.key: flow for trace in found for flow in trace.flows}
    graph = to_graph(str(resource.id), sorted(flows.values(), key=lambda flow: flow.order))
    unread = frozenset().union(*(trace.unread for trace in found))
    return {
        **_named(graph),
        "truncated": sum(trace.beyond for trace in found) + len(unread),
        "unread": sorted(unread),
    }


def _named(graph: dict[str, Any]) -> dict[str, Any]:
    ids = [node["id"] for node in graph["nodes"]]
    plain = [i for i in ids if not i.startswith("lot:")]
    resources = {str(r.id): r for r in resource_selectors.rows(UUID(i) for i in plain)}
    lot_ids = [i.removeprefix("lot:") for i in ids if i.startswith("lot:")]
    lots = {f"lot:{lot.id}": lot for lot in resource_selectors.find_lots(lot_ids)}
    transactions = {str(t.id): t for t in Transaction.objects.filter(pk__in=plain)}
    for node in graph["nodes"]:
        node.setdefault("at", None)
        if node["id"] in resources:
            row = resources[node["id"]]
            node.update(name=row.name, detail=row.kind)
        elif node["id"] in lots:
            node.update(name=str(lots[node["id"]]), detail=lots[node["id"]].key)
        else:
            act = transactions[node["id"]]
            node.update(name=act.name, detail=f"{act.state}, {act.verification or 'assumed'}")
            node["job_id"] = None if act.job_id is None else str(act.job_id)
    return graph
