"""Reads of tickets: contradictions that a person has to look at."""

from __future__ import annotations

from collections.abc import Collection
from uuid import UUID

from django.db.models import QuerySet

from labweb.crutd.models import Ticket, Transaction
from labweb.domain.crutd import operations
from labweb.domain.errors import NotFoundError
from labweb.resources.selectors import Lab, Resource


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
