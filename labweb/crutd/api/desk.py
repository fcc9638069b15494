"""REST of what a person settles at the desk: taking stock, and tickets."""

from __future__ import annotations

from typing import ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.answers import NamedRef
from labweb.common.requests import body
from labweb.crutd import selectors, services
from labweb.crutd.answers import (
    ReactionLot,
    ReactionMaterial,
    ReactionStock,
    StockLot,
    StockTaking,
    TicketDetail,
    TicketResource,
)
from labweb.crutd.api import visible
from labweb.crutd.models import Ticket
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd import operations
from labweb.domain.crutd.ledger import Account
from labweb.domain.errors import NotFoundError
from labweb.domain.resources.contents_by_lot import Phase
from labweb.domain.resources.resource_kinds import is_vessel
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lot


class Stock(Endpoint):
    """What a person needs to take stock of a resource."""

    def get(self, request: Request, resource_id: UUID) -> StockTaking:
        """Tell whether the caller may take stock of it now, and which lots it could hold."""
        row = visible(request, resource_id)
        user = user_of(request)
        lab = resource_selectors.the_lab()
        look = operations.Correct(resource_id=row.id, account=Account.SUSPENSE, reason="look")
        findings = services.check_operation(look, lab=lab, actor_id=user.pk)
        why_not = findings[0].message if findings else None
        if row.id not in resource_selectors.allowed_ids(user, Permission.RESOLVE):
            why_not = "only people with the right to resolve may take stock here"
        seen = resource_selectors.allowed_ids(user, Permission.VIEW)
        lots = [_lot(lot) for lot in selectors.visible_lots(lab, seen)]
        return StockTaking(is_allowed=why_not is None, why_not=why_not, lots=lots)


def _lot(lot: Lot) -> StockLot:
    return StockLot(
        lot_id=lot.id,
        lot=lot.number or lot.key,
        material=lot.material.name,
        unit=Phase(lot.phase).unit,
    )


class Reaction(Endpoint):
    """What a person needs to tell of a reaction in a vessel."""

    def get(self, request: Request, resource_id: UUID) -> ReactionStock:
        """Tell whether the caller may, which lots it holds, and of which materials products are."""
        row = visible(request, resource_id)
        user = user_of(request)
        if not is_vessel(row.kind):
            raise NotFoundError(f"{row.name} holds nothing", code="resource.not_found")
        is_allowed = row.id in resource_selectors.allowed_ids(user, Permission.RUN)
        held = selectors.amounts([row.id]).get(row.id, {})
        lots = {str(lot.id): lot for lot in resource_selectors.find_lots(held)}
        materials = resource_selectors.materials_of(row.lab) if is_allowed else ()
        return ReactionStock(
            is_allowed=is_allowed,
            lots=[
                ReactionLot(
                    **msgspec.structs.asdict(_lot(lots[lot])),
                    amount=amount.nl or amount.ug,
                    density_mg_ul=lots[lot].material.density_mg_ul,
                )
                for lot, amount in sorted(held.items())
            ],
            materials=[
                ReactionMaterial(
                    id=material.id, name=material.name, density_mg_ul=material.density_mg_ul
                )
                for material in sorted(materials, key=lambda one: (one.name, one.key))
            ],
        )


class Closing(msgspec.Struct, forbid_unknown_fields=True):
    """Why a ticket may be closed."""

    reason: str


class OneTicket(Endpoint):
    """One contradiction between record and world."""

    def get(self, request: Request, ticket_id: UUID) -> TicketDetail:
        """Return a ticket with the resources and the host it concerns."""
        return _ticket(request, _seen(request, ticket_id))


class CloseTicket(Endpoint):
    """The end of a ticket."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Closing}

    def post(self, request: Request, ticket_id: UUID) -> TicketDetail:
        """Close a ticket that a person has looked into; the reason is kept."""
        _seen(request, ticket_id)
        reason = body(request, Closing).reason
        ticket = services.close_ticket(ticket_id, actor=user_of(request), reason=reason)
        return _ticket(request, ticket)


def _seen(request: Request, ticket_id: UUID) -> Ticket:
    """Return a ticket the caller may see.

    Raises:
        NotFoundError: There is none, or none the caller may know of.
    """
    ticket = selectors.find_ticket(ticket_id)
    seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
    if not selectors.concerns([ticket])[ticket.id] <= seen:
        raise NotFoundError(f"no ticket {ticket_id}", code="ticket.not_found")
    return ticket


def _ticket(request: Request, ticket: Ticket) -> TicketDetail:
    ids = selectors.concerns([ticket])[ticket.id]
    allowed = resource_selectors.allowed_ids(user_of(request), Permission.RESOLVE)
    host_id = ticket.detail.get("host_id")
    host = None if host_id is None else enrollment_selectors.find_host(UUID(host_id))
    return TicketDetail(
        id=ticket.id,
        code=ticket.code,
        message=ticket.message,
        detail=ticket.detail,
        resources=[
            TicketResource(id=row.id, name=row.name, is_quarantined=row.quarantined_by is not None)
            for row in resource_selectors.rows(ids)
        ],
        host=None if host is None else NamedRef(id=host.id, name=host.name),
        opened_at=ticket.opened_at,
        closed_at=ticket.closed_at,
        closed_by=None if ticket.closed_by is None else ticket.closed_by.printed_name,
        can_close=ticket.closed_at is None and ids <= allowed,
    )
