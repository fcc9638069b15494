"""Who may have a resource now: nobody whom a lock or a reservation stands against."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any
from uuid import UUID
from zoneinfo import ZoneInfo

from django.db import OperationalError

from labweb.accounts import selectors as account_selectors
from labweb.common.database.prepared_queries import Question, together
from labweb.crutd import selectors
from labweb.crutd.selectors import reservations
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.crutd import operations
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.errors import Finding, LockedError
from labweb.domain.runs.exclusive_use.action_locks import Lock, conflicts, lock_set
from labweb.domain.runs.exclusive_use.reservations import ReservedLock, in_the_way
from labweb.domain.runs.exclusive_use.run_holds import ROOMY, places_of
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Above, Resource


def hold(ids: Collection[UUID]) -> tuple[dict[UUID, Resource], Above]:
    """Lock the rows, and share those above them; never waits, so that nobody waits in a ring."""
    rows, above, _ = hold_and_ask(ids)
    return rows, above


def hold_and_ask(
    ids: Collection[UUID], *questions: Question[Any], places: Collection[UUID] = ()
) -> tuple[dict[UUID, Resource], Above, list[list[Any]]]:
    """Lock as above, and ask what is to be read under the locks; one exchange.

    Args:
        ids: What is locked.
        questions: What is asked.
        places: Those of them that something is only put into or taken from.

    Raises:
        LockedError: Somebody holds one of the rows this moment.
    """
    busy = LockedError("the resources are in use this moment", code="crutd.busy")
    try:
        found, *answers = together(resource_selectors.asking_hold(ids, places), *questions)
    except OperationalError as error:
        raise busy from error
    held = resource_selectors.held_of(found)
    if held is None:
        raise busy
    return *held, answers


def check_free(
    rows: Mapping[UUID, Resource],
    wanted: Sequence[Lock],
    actor_id: UUID | None,
    uses: reservations.Uses | None = None,
) -> None:
    """Refuse what somebody else uses or has reserved, by name.

    Args:
        rows: What is asked for, locked.
        wanted: The locks on it and on what is above it.
        actor_id: Who asks.
        uses: Who has them now; None looks.

    Raises:
        LockedError: `context` says which transaction holds it, or who reserved it until when.
    """
    held, claims = reservations.uses(rows, actor_id) if uses is None else uses
    blocked = conflicts(wanted, [lock for lock, _ in held])
    if blocked:
        holder = next(owner for lock, owner in held if lock.resource_id == blocked[0])
        raise LockedError(
            f"{_name_of(blocked[0], rows)} is in use: {_what_holds(holder)}",
            code="crutd.locked",
            context={"resource_id": str(blocked[0]), "transaction_id": str(holder)},
        )
    _refuse(_in_the_way(wanted, claims, actor_id))


def _name_of(resource_id: UUID, rows: Mapping[UUID, Resource]) -> str:
    """Return the name of a thing, or say how it concerns those that are asked for."""
    if resource_id in rows:
        return rows[resource_id].name
    names = " and ".join(sorted(row.name for row in rows.values()))
    return f"what {names} stands in"


def _what_holds(transaction_id: UUID) -> str:
    """Say what has to end before, and whether it takes a person."""
    holder = selectors.find_transaction(transaction_id)
    if holder.state == TransactionState.QUARANTINED.value:
        return f"a person answers first what became of its {holder.name} in doubt"
    return f"its {holder.name} has not ended yet"


def _refuse(findings: Sequence[Finding]) -> None:
    if findings:
        first = findings[0]
        raise LockedError(
            first.message, code=first.code, findings=findings, context=dict(first.context)
        )


def roomy_of(operation: operations.Operation, rows: Mapping[UUID, Resource]) -> set[UUID]:
    """Return the places of an operation in which it disturbs nothing that stands there."""
    places = set(places_of(operation)).intersection(rows)
    return {node for node in places if rows[node].kind in ROOMY}


def is_free(ids: Collection[UUID], *, actor_id: UUID | None) -> bool:
    """Say whether nobody stands in the way at this moment; takes no lock, and promises nothing.

    Who waits looks here first: to ask for locks that are not to be had takes the rows from
    those who could have them.
    """
    wanted = lock_set(ids, resource_selectors.ancestors(ids))
    held, claims = reservations.uses(ids, actor_id)
    return not conflicts(wanted, [lock for lock, _ in held]) and not in_the_way(wanted, claims)


def refuse_reserved_by_others(
    ids: Collection[UUID], *, actor_id: UUID | None, is_any: bool | None = None
) -> None:
    """Refuse to plan on what others have reserved.

    Args:
        ids: What the plan uses.
        actor_id: Whose plan it is.
        is_any: Whether others have reserved anything at all; None looks.

    Raises:
        LockedError: `findings` list each reservation in the way.
    """
    if is_any is not False:
        _refuse(reserved_findings(ids, actor_id))


def reserved_findings(
    ids: Collection[UUID], actor_id: UUID | None, roomy: Collection[UUID] = ()
) -> list[Finding]:
    """List what others have reserved of these resources, of those above and of those below.

    Args:
        ids: The resources.
        actor_id: Who asks.
        roomy: Those of which the parts that others have reserved do not matter.
    """
    if not reservations.is_any_live(actor_id):
        return []
    wanted = lock_set(ids, resource_selectors.ancestors(ids), roomy)
    _, claims = reservations.uses(ids, actor_id)
    return _in_the_way(wanted, claims, actor_id)


def _in_the_way(
    wanted: Sequence[Lock], claims: Sequence[ReservedLock], actor_id: UUID | None
) -> list[Finding]:
    rows = [reservations.find_reservation(one) for one in in_the_way(wanted, claims)]
    actor = account_selectors.user_by_id(actor_id) if rows and actor_id is not None else None
    if actor is None:
        return [_finding(row) for row in rows]
    seen = resource_selectors.allowed_ids(actor, Permission.VIEW)
    return [_finding(row) if row.resource_id in seen else _hidden(row) for row in rows]


def _hidden(row: reservations.ResourceReservation) -> Finding:
    """Say when to come again, and nothing of what the asker may not know of."""
    text = f"what it stands in, or what stands in it, is reserved until {_until(row)}"
    return Finding("crutd.reserved", text, "", {"expires_at": row.expires_at.isoformat()})


def _until(row: reservations.ResourceReservation) -> str:
    zone = ZoneInfo(row.resource.lab.time_zone)
    return f"{row.expires_at.astimezone(zone):%Y-%m-%d %H:%M}"


def _finding(row: reservations.ResourceReservation) -> Finding:
    return Finding(
        "crutd.reserved",
        f"{row.resource.name} is reserved by {row.holder.printed_name} until {_until(row)}: "
        f"{row.reason}",
        str(row.resource_id),
        {
            "reservation_id": str(row.pk),
            "resource_id": str(row.resource_id),
            "holder": row.holder.printed_name,
            "expires_at": row.expires_at.isoformat(),
        },
    )
