"""What the record says of transactions, resources, lots and moves, for the graph."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from datetime import datetime
from typing import Any
from uuid import UUID

from django.db import connection
from django.db.models import Q

from labweb.common.render import iso
from labweb.crutd.models import Event, EventSubject, Transaction
from labweb.crutd.selectors.doubt_resolutions import Resolved, resolved_of
from labweb.domain.crutd.operations import OperationName
from labweb.domain.crutd.provenance.recorded_facts import LotFact, ResourceFact, TransactionFact
from labweb.domain.crutd.provenance.stays_at_places import PlaceMove
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.resources import selectors as resource_selectors

MOST_ACTS = 1000
"""Acts other than pouring that one answer may hold."""

COLLECTIONS = {"plate", "tip_rack", "tube_rack"}
"""Kinds whose parts are members of a whole."""

_ACTS = """
SELECT DISTINCT e.seq, e.transaction_id
FROM unnest(%s::uuid[], %s::bigint[], %s::bigint[]) AS stay(resource_id, first, last)
CROSS JOIN LATERAL (
    SELECT event_id FROM crutd_eventsubject
    WHERE resource_id = stay.resource_id AND role = 'subject' OFFSET 0
) s
JOIN crutd_event e ON e.id = s.event_id AND e.seq BETWEEN stay.first AND stay.last
ORDER BY e.seq DESC
LIMIT %s
"""
"""Who pours is `source`, who is poured into `target`: those are left to the ledger. OFFSET 0
keeps the planner from reading the whole table once instead of a few rows of each resource."""

_LAST_AT = """
SELECT moment.at, COALESCE(
    (SELECT max(seq) FROM crutd_event e WHERE e.lab_id = %s AND e.at <= moment.at), 0
)
FROM unnest(%s::timestamptz[]) AS moment(at)
"""

FOREVER = 2**62
"""Later in the chain than every event."""

Window = tuple[UUID, int, int]
"""A resource, and the first and last place in the chain of events."""


def seqs(transaction_ids: Iterable[UUID]) -> dict[UUID, int]:
    """Return the place in the chain of the last event of each transaction."""
    rows = Event.objects.filter(transaction_id__in=list(transaction_ids)).order_by("seq")
    return dict(rows.values_list("transaction_id", "seq"))


def job_seqs(job_ids: Iterable[UUID]) -> dict[UUID, tuple[int, datetime]]:
    """Return place in the chain and time of the last event of each job."""
    rows = Event.objects.filter(transaction__job_id__in=list(job_ids)).order_by("seq")
    found = rows.values_list("transaction__job_id", "seq", "at")
    return {job_id: (seq, at) for job_id, seq, at in found if job_id is not None}


def seqs_at(lab_id: UUID, moments: Iterable[datetime]) -> dict[datetime, int]:
    """Return the place in the chain of the last event up to each moment; 0 before the first."""
    with connection.cursor() as cursor:
        cursor.execute(_LAST_AT, [lab_id, sorted(set(moments))])
        return dict(cursor.fetchall())


def acts_within(windows: Collection[Window], limit: int = MOST_ACTS) -> tuple[list[UUID], bool]:
    """Return transactions on resources within windows, the newest first; none that pours.

    Returns:
        Their ids, and whether there are more than `limit`.
    """
    ids, firsts, lasts = zip(*windows, strict=True) if windows else ((), (), ())
    with connection.cursor() as cursor:
        cursor.execute(_ACTS, [list(ids), list(firsts), list(lasts), limit + 1])
        found = [row[1] for row in cursor.fetchall()]
    return list(dict.fromkeys(found[:limit])), len(found) > limit


def transaction_facts(ids: Iterable[UUID]) -> list[TransactionFact]:
    """Return transactions, each with the newest of its events, and how its doubt has ended.

    Two queries, and two more where one of them was in doubt.
    """
    rows = list(Transaction.objects.filter(pk__in=list(ids)))
    events: dict[UUID, tuple[int, str, Any]] = {}
    doubtful: set[UUID] = set()
    found = Event.objects.filter(transaction__in=[row.pk for row in rows]).order_by("seq")
    told = found.values_list("transaction_id", "seq", "hash", "at", "state")
    for about, seq, digest, at, state in told:
        events[about] = (seq, digest, at)
        if state == TransactionState.QUARANTINED.value:
            doubtful.add(about)
    ends = resolved_of(doubtful)
    facts = [_fact(row, *events.get(row.id, (0, "", None))) for row in rows]
    return [_with_end(fact, ends.get(UUID(fact.id))) for fact in facts]


def _with_end(fact: TransactionFact, end: Resolved | None) -> TransactionFact:
    if end is None:
        return fact
    resolved = f"{end.told().text}, {iso(end.at)}"
    return replace(fact, doubt_at=iso(end.doubt_at) or "", resolved=resolved)


def _fact(row: Transaction, seq: int, digest: str, at: Any) -> TransactionFact:  # noqa: ANN401
    return TransactionFact(
        id=str(row.id),
        seq=seq,
        name=row.name,
        state=row.state,
        started_at=iso(row.proposed_at) or "",
        ended_at=iso(row.settled_at or at) or "",
        operation=row.operation,
        change=row.change or {},
        verification=row.verification,
        code=row.code,
        event_hash=digest,
        actor_id=_text(row.actor_id),
        job_id=_text(row.job_id),
    )


def _text(value: object) -> str:
    return "" if value is None else str(value)


def resource_facts(ids: Collection[UUID]) -> list[ResourceFact]:
    """Return resources, with the plate or rack that each stands in."""
    rows = list(resource_selectors.rows(ids))
    above = resource_selectors.rows({row.parent_id for row in rows if row.parent_id is not None})
    kinds: dict[UUID | None, str] = dict(above.values_list("id", "kind"))
    return [
        ResourceFact(
            id=str(row.id),
            name=row.name,
            kind=row.kind,
            collection_id=str(row.parent_id) if kinds.get(row.parent_id) in COLLECTIONS else "",
        )
        for row in rows
    ]


def lot_facts(ids: Iterable[str]) -> list[LotFact]:
    """Return lots with their materials."""
    return [
        LotFact(
            id=str(row.id),
            name=str(row),
            material=row.material.name,
            number=row.number,
            supplier=row.supplier,
            expires_on="" if row.expires_on is None else row.expires_on.isoformat(),
        )
        for row in resource_selectors.find_lots(ids)
    ]


def moves_of(ids: Collection[str]) -> list[PlaceMove]:
    """Return every committed change of place of the resources; one query."""
    rows = EventSubject.objects.filter(
        Q(event__state="committed"),
        resource_id__in=list(ids),
        role="subject",
    ).exclude(event__body__change__moves={})
    found = []
    facts = rows.values_list("resource_id", "event__at", "event__body")
    for resource_id, at, body in facts:
        change: Mapping[str, Any] = body.get("change") or {}
        target = (change.get("moves") or {}).get(str(resource_id))
        source = body["operation"].get("from_id")
        if target is not None:
            found.append(PlaceMove(at, str(resource_id), _text(source), str(target)))
    return found


def made_at(lab_id: UUID, resource_id: UUID) -> datetime | None:
    """Return when a resource came to be: it was created, or imported with its lab."""
    events = Event.objects.filter(lab_id=lab_id)
    about = events.filter(subjects__resource_id=resource_id, subjects__role="subject")
    created = about.filter(name=OperationName.CREATE.value, state="committed")
    found = created.order_by("seq").values_list("at", flat=True).first()
    return found or events.order_by("seq").values_list("at", flat=True).first()


def parents_of(ids: Collection[str]) -> dict[str, str | None]:
    """Return where each resource stands now; one query."""
    rows = resource_selectors.rows(UUID(i) for i in ids).values_list("id", "parent_id")
    return {str(node): _text(parent) or None for node, parent in rows}
