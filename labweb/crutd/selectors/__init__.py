"""Reads of the ledger, transactions and events."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any
from uuid import UUID

from django.contrib.postgres.fields import ArrayField
from django.db.models import F, Q, QuerySet, Sum, UUIDField

from labweb.common.database.prepared_queries import (
    Given,
    IsAnyOf,
    Prepared,
    Question,
    prepared_cursor,
    together,
)
from labweb.crutd.models import Entry, EventSubject
from labweb.crutd.models import Event as Event
from labweb.crutd.models import Holding as Holding
from labweb.crutd.models import Ticket as Ticket
from labweb.crutd.models import Transaction as Transaction
from labweb.domain.crutd import operations
from labweb.domain.crutd.balance import Move
from labweb.domain.crutd.decide import ResourceState
from labweb.domain.crutd.ledger import Amount
from labweb.domain.crutd.lifecycle import FINAL, TransactionState
from labweb.domain.crutd.provenance import is_nominal
from labweb.domain.errors import NotFoundError
from labweb.domain.resources.contents import LotId
from labweb.domain.runs.locks import Lock, LockMode
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Above, Lab, Lot, Resource

# Written out: it is on the way of every operation of the lab.
_LOCKS = """
SELECT resource_id, mode, transaction_id FROM crutd_resourcelock
WHERE resource_id = ANY(%s) AND released_at IS NULL
"""

_AMOUNTS = """
SELECT resource_id, lot_id, amount_nl, amount_ug FROM crutd_holding
WHERE resource_id = ANY(%s) AND (amount_nl <> 0 OR amount_ug <> 0)
"""

_AMOUNTS_OF_LAB = """
SELECT resource_id, lot_id, amount_nl, amount_ug FROM crutd_holding
JOIN resources_resource ON resources_resource.id = resource_id
WHERE lab_id = %s AND (amount_nl <> 0 OR amount_ug <> 0)
"""


def contents(ids: Iterable[UUID]) -> dict[UUID, dict[LotId, int]]:
    """Return nanolitres by lot of each vessel; empty ones are missing."""
    found: dict[UUID, dict[LotId, int]] = {}
    for resource_id, held in amounts(ids).items():
        liquids = {lot: amount.nl for lot, amount in held.items() if amount.nl}
        if liquids:
            found[resource_id] = liquids
    return found


def amounts(ids: Iterable[UUID]) -> dict[UUID, dict[LotId, Amount]]:
    """Return what each vessel holds by lot, whatever it is counted in; empty ones are missing."""
    (rows,) = together(Question(_AMOUNTS, [list(ids)], tuple))
    return _amounts(rows)


def asking_amounts(lab_id: UUID) -> Question[tuple[Any, ...]]:
    """Return what finds all that a lab's vessels hold, for `lab_snapshot`."""
    return Question(_AMOUNTS_OF_LAB, [lab_id], tuple)


def _amounts(rows: Iterable[tuple[Any, ...]]) -> dict[UUID, dict[LotId, Amount]]:
    found: dict[UUID, dict[LotId, Amount]] = {}
    for resource_id, lot_id, nl, ug in rows:
        found.setdefault(resource_id, {})[LotId(str(lot_id))] = Amount(nl, ug)
    return found


_NOTHING: Mapping[LotId, Amount] = {}


def state_of(
    row: Resource,
    held: Mapping[LotId, Amount],
    above: tuple[UUID, ...] = (),
    *,
    is_archived: bool = False,
) -> ResourceState:
    """Turn a row and its contents into what a decision needs."""
    return ResourceState(
        id=row.id,
        name=row.name,
        kind=row.kind,
        parent_id=row.parent_id,
        contents={lot: amount.nl for lot, amount in held.items() if amount.nl},
        masses={lot: amount.ug for lot, amount in held.items() if amount.ug},
        capacity_nl=capacity_nl_of(row),
        capacity_ug=_thousandfold(row.config.get("capacity_mg")),
        dead_volume_nl=_thousandfold(row.config.get("dead_volume_ul")) or 0,
        data=row.data,
        quarantined_by=None if row.quarantined_by is None else str(row.quarantined_by),
        is_archived=row.is_archived or is_archived,
        ancestor_ids=above,
    )


def _thousandfold(value: object) -> int | None:
    """Return a figure of a config in the finer unit; what is no number states nothing.

    What came from elsewhere and was kept as it was (`foreign`) may say anything.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return round(value * 1000)


def capacity_nl_of(row: Resource) -> int | None:
    """Return how much liquid a resource holds; None: nobody stated it."""
    return _thousandfold(row.config.get("capacity_ul"))


def snapshot(rows: Iterable[Resource]) -> dict[UUID, ResourceState]:
    """Return the frozen state of the rows for a decision; two queries."""
    nodes = list(rows)
    above = resource_selectors.ancestors_and_archived(row.id for row in nodes)
    return _states(nodes, amounts(row.id for row in nodes), above)


def snapshot_and_lots(
    rows: Collection[Resource], known: Above
) -> tuple[dict[UUID, ResourceState], dict[LotId, Lot]]:
    """Return the state of rows whose way up is known, and the lots they hold; one query."""
    return states_and_lots(rows, known, HELD.rows(ids=[row.id for row in rows]))


def states_and_lots(
    rows: Collection[Resource], known: Above, holdings: Iterable[Holding]
) -> tuple[dict[UUID, ResourceState], dict[LotId, Lot]]:
    """Return the same of rows whose holdings were read by `HELD`."""
    held: dict[UUID, dict[LotId, Amount]] = {}
    lots: dict[LotId, Lot] = {}
    for holding in holdings:
        if holding.amount_nl or holding.amount_ug:
            lot = LotId(str(holding.lot_id))
            lots[lot] = holding.lot
            amount = Amount(holding.amount_nl, holding.amount_ug)
            held.setdefault(holding.resource_id, {})[lot] = amount
    return _states(rows, held, known), lots


HELD = Prepared(
    lambda: Holding.objects.filter(
        IsAnyOf(F("resource_id"), Given("ids", ArrayField(UUIDField())))
    ).select_related("lot__material")
)


def snapshot_in_place(rows: Collection[Resource]) -> dict[UUID, ResourceState]:
    """Return the state of rows without where they stand, for a view or a settlement; one query."""
    return _states(rows, amounts(row.id for row in rows), ({}, set()))


def _states(
    rows: Iterable[Resource], held: Mapping[UUID, Mapping[LotId, Amount]], known: Above
) -> dict[UUID, ResourceState]:
    above, archived = known
    return {
        row.id: state_of(
            row, held.get(row.id, _NOTHING), above.get(row.id, ()), is_archived=row.id in archived
        )
        for row in rows
    }


def lab_snapshot(
    rows: Collection[Resource], told: Iterable[tuple[Any, ...]] | None = None
) -> dict[UUID, ResourceState]:
    """Return the state of all the nodes of a lab, for compiling a workflow.

    Args:
        rows: The nodes.
        told: What `asking_amounts` has found; None reads it in one query.
    """
    held = amounts(row.id for row in rows) if told is None else _amounts(told)
    parents = {row.id: row.parent_id for row in rows}
    closed = {row.id for row in rows if row.is_archived}
    found = {}
    for row in rows:
        above = tuple(_climb(row.id, parents))
        is_archived = not closed.isdisjoint(above)
        found[row.id] = state_of(row, held.get(row.id, _NOTHING), above, is_archived=is_archived)
    return found


def _climb(node: UUID, parents: dict[UUID, UUID | None]) -> Iterable[UUID]:
    parent = parents[node]
    while parent is not None:
        yield parent
        parent = parents[parent]


def held_locks(ids: Iterable[UUID]) -> list[tuple[Lock, UUID]]:
    """Return live locks on the resources, each with its transaction."""
    with prepared_cursor() as cursor:
        cursor.execute(_LOCKS, [list(ids)])
        return [(Lock(held, LockMode(mode)), owner) for held, mode, owner in cursor.fetchall()]


def transaction_for_update(transaction_id: UUID) -> Transaction:
    """Lock and return a transaction.

    Raises:
        NotFoundError: There is none.
    """
    row = Transaction.objects.filter(pk=transaction_id).select_for_update(no_key=True).first()
    if row is None:
        raise NotFoundError(f"no transaction {transaction_id}", code="crutd.no_transaction")
    return row


def find_transaction(transaction_id: UUID) -> Transaction:
    """Return a transaction.

    Raises:
        NotFoundError: There is none.
    """
    row = Transaction.objects.filter(pk=transaction_id).first()
    if row is None:
        raise NotFoundError(f"no transaction {transaction_id}", code="crutd.no_transaction")
    return row


def events_of(
    lab: Lab, *, resource_id: UUID | None = None, job_ids: Iterable[UUID] | None = None
) -> QuerySet[Event]:
    """Return events, newest first, with their transactions."""
    rows = Event.objects.filter(lab=lab).select_related("transaction")
    if resource_id is not None:
        rows = rows.filter(subjects__resource_id=resource_id).distinct()
    if job_ids is not None:
        rows = rows.filter(transaction__job_id__in=list(job_ids))
    return rows.order_by("-seq")


def subjects_of(event_ids: Iterable[int]) -> dict[int, list[EventSubject]]:
    """Return the resources of each event."""
    found: dict[int, list[EventSubject]] = {}
    rows = EventSubject.objects.filter(event_id__in=list(event_ids)).select_related("resource")
    for row in rows:
        found.setdefault(row.event_id, []).append(row)
    return found


def balance_by_lot(lab: Lab) -> dict[UUID, int]:
    """Return, by lot, credits minus debits over all accounts; zero when nothing was lost."""
    posted = Entry.objects.filter(state=Entry.State.POSTED, transaction__lab=lab)
    held = (
        Holding.objects.filter(resource__lab=lab).values("lot_id").annotate(total=Sum("amount_nl"))
    )
    sums = {row["lot_id"]: row["total"] for row in held}
    for lot_id, debit, credit, amount in posted.values_list(
        "lot_id", "debit", "credit", "amount_nl"
    ):
        if lot_id is None:
            continue
        for account, sign in ((debit, 1), (credit, -1)):
            if not is_nominal(account):
                sums[lot_id] = sums.get(lot_id, 0) + sign * amount
    return sums


def visible_lots(lab: Lab, seen: Collection[UUID]) -> list[Lot]:
    """Return the lots that one of the resources holds; all to who sees the root."""
    lots = resource_selectors.lots_of(lab)
    if resource_selectors.root_of(lab).id in seen:
        return list(lots)
    some = Q(amount_nl__gt=0) | Q(amount_ug__gt=0)
    held = Holding.objects.filter(some, resource_id__in=list(seen))
    return list(lots.filter(pk__in=held.values("lot_id")))


def open_tickets(lab: Lab) -> QuerySet[Ticket]:
    """Return contradictions nobody has looked at."""
    return Ticket.objects.filter(lab=lab, closed_at__isnull=True).order_by("opened_at")


def visible_tickets(lab: Lab, seen: Collection[UUID]) -> list[Ticket]:
    """Return the open tickets that concern nothing but the given resources."""
    tickets = list(open_tickets(lab))
    if not tickets:
        return []
    known = concerns(tickets)
    return [ticket for ticket in tickets if known[ticket.id].issubset(seen)]


def find_ticket(ticket_id: UUID) -> Ticket:
    """Return a ticket.

    Raises:
        NotFoundError: There is none.
    """
    row = Ticket.objects.filter(pk=ticket_id).select_related("lab", "closed_by").first()
    if row is None:
        raise NotFoundError(f"no ticket {ticket_id}", code="ticket.not_found")
    return row


def ticket_for_update(ticket_id: UUID) -> Ticket:
    """Lock and return a ticket.

    Raises:
        NotFoundError: There is none.
    """
    row = Ticket.objects.filter(pk=ticket_id).select_for_update(of=("self",), no_key=True).first()
    if row is None:
        raise NotFoundError(f"no ticket {ticket_id}", code="ticket.not_found")
    return row


def concerns(tickets: Collection[Ticket]) -> dict[UUID, set[UUID]]:
    """Return what each ticket of one lab is about: what a transaction touches, or all."""
    told = {ticket.id: ticket.detail.get("transaction_id") for ticket in tickets}
    rows = Transaction.objects.filter(pk__in=[one for one in told.values() if one])
    touched = {
        str(pk): set(operations.touched_ids(operations.from_json(operation)))
        for pk, operation in rows.values_list("pk", "operation")
    }
    roots = Resource.objects.filter(
        lab__in={ticket.lab_id for ticket in tickets}, parent__isnull=True
    )
    everything = set(roots.values_list("pk", flat=True))
    return {ticket: touched.get(one or "", everything) for ticket, one in told.items()}


@dataclass(frozen=True, slots=True)
class GivenUp:
    """A resource still quarantined though its transaction is over."""

    resource: Resource
    at: datetime


def given_up(lab: Lab) -> list[GivenUp]:
    """Return what nobody can answer for any more, oldest first; two queries at most.

    Only taking stock tells what these hold.
    """
    closed = resource_selectors.resources_of(lab).filter(quarantined_by__isnull=False)
    rows = {row.id: row for row in closed}
    if not rows:
        return []
    over = Transaction.objects.filter(
        pk__in={row.quarantined_by for row in rows.values()},
        state__in=[state.value for state in FINAL],
        settled_at__isnull=False,
    )
    ends = {pk: at for pk, at in over.values_list("pk", "settled_at") if at is not None}
    found = [
        GivenUp(row, ends[row.quarantined_by])
        for row in rows.values()
        if row.quarantined_by in ends
    ]
    return sorted(found, key=lambda one: one.at)


def posted_by(job_ids: Iterable[UUID]) -> list[Move]:
    """Return what the jobs moved, entry by entry."""
    rows = Entry.objects.filter(state=Entry.State.POSTED, transaction__job_id__in=list(job_ids))
    columns = ("lot_id", "debit", "credit", "amount_nl", "amount_ug")
    return [
        Move(LotId(str(lot)), debit, credit, nl, ug)
        for lot, debit, credit, nl, ug in rows.values_list(*columns)
    ]


def reactions_of(job_ids: Iterable[UUID]) -> list[operations.React]:
    """Return the reactions that the jobs have put on record, in their order."""
    done = Transaction.objects.filter(
        job_id__in=list(job_ids), state=TransactionState.COMMITTED.value, operation__op="react"
    )
    told = done.order_by("settled_at", "id").values_list("operation", flat=True)
    found = (operations.from_json(plain) for plain in told)
    return [one for one in found if isinstance(one, operations.React)]


def standing(lot_ids: Iterable[UUID]) -> dict[LotId, dict[UUID, Amount]]:
    """Return where each lot stands now, by vessel; what is in the waste is not there any more."""
    rows = Holding.objects.filter(lot_id__in=list(lot_ids)).exclude(resource__kind="waste")
    found: dict[LotId, dict[UUID, Amount]] = {}
    for lot, vessel, nl, ug in rows.values_list("lot_id", "resource_id", "amount_nl", "amount_ug"):
        if nl or ug:
            found.setdefault(LotId(str(lot)), {})[vessel] = Amount(nl, ug)
    return found
