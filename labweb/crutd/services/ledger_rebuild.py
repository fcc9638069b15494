"""Write tree, lots, ledger and states anew from the import and the events."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any
from uuid import UUID

from django.db import connection
from django.db.transaction import atomic

from labweb.common.clock import now
from labweb.crutd.models import (
    Entry,
    Event,
    EventHead,
    EventSubject,
    LabBase,
    ResourceLock,
    Transaction,
)
from labweb.crutd.selectors.event_chain import events_in_order, first_broken_event
from labweb.crutd.selectors.history_replay import base_of, rebuild_differences, replayed
from labweb.crutd.services.lab_import import rows_of
from labweb.crutd.services.ledger_posting import reserve
from labweb.domain.crutd import operations
from labweb.domain.crutd.event_replay import Replay, ReplayNode
from labweb.domain.crutd.ledger import posting_from
from labweb.domain.crutd.reserved_amounts import reservations
from labweb.domain.crutd.transaction_states import FINAL, TransactionState
from labweb.domain.errors import ReconcileError, StateError
from labweb.domain.graph.lab_file.lab_model import LabFile
from labweb.resources import services as resource_services
from labweb.resources.selectors import Lab, Resource

_CHUNK = 5000
_UNDER_WAY = ("locked", "executing", "confirming")

_EMPTY_LEDGER = (
    "SET CONSTRAINTS ALL IMMEDIATE",
    "ALTER TABLE crutd_entry DISABLE TRIGGER crutd_entry_append_only",
    "ALTER TABLE crutd_holding DISABLE TRIGGER crutd_holding_by_entries",
    "ALTER TABLE crutd_balance DISABLE TRIGGER crutd_balance_by_entries",
    "DELETE FROM crutd_entry USING crutd_transaction t WHERE t.id = transaction_id AND lab_id = %s",
    "DELETE FROM crutd_holding USING resources_resource r WHERE r.id = resource_id AND lab_id = %s",
    "DELETE FROM crutd_balance USING resources_resource r WHERE r.id = resource_id AND lab_id = %s",
    "ALTER TABLE crutd_entry ENABLE TRIGGER crutd_entry_append_only",
    "ALTER TABLE crutd_holding ENABLE TRIGGER crutd_holding_by_entries",
    "ALTER TABLE crutd_balance ENABLE TRIGGER crutd_balance_by_entries",
    "SET CONSTRAINTS ALL DEFERRED",
)
"""Rules that forbid a deletion rest while these statements run, and in this transaction alone."""


@atomic
def rebuild(lab: Lab) -> None:
    """Write what events tell in place of what the rows say; all of it, or nothing.

    Tree, materials, lots, entries, balances and the states of transactions come from the import
    and the events; so it does not matter whether their rows are wrong, in part, or gone. What
    the ledger had promised for transactions that have ended is not written again.

    Raises:
        ReconcileError: The chain of events is broken, or it cannot be replayed, or a row is
            left of which no event tells. Nothing was written.
        StateError: `rebuild.under_way`: a transaction is under way, which no event tells of yet.

    Effect:
        None on matter. Locks the ledger against everybody until it is done.
    """
    with connection.cursor() as cursor:
        cursor.execute("LOCK TABLE crutd_event, crutd_entry, crutd_transaction IN EXCLUSIVE MODE")
    broken = first_broken_event(lab)
    if broken is not None:
        raise ReconcileError(broken.message, code="rebuild.chain", context=broken.context)
    if Transaction.objects.filter(lab=lab, state__in=_UNDER_WAY).exists():
        raise StateError(
            "a transaction is under way: pause the runs and wait for it", code="rebuild.under_way"
        )
    base, told = base_of(lab), replayed(lab)
    _empty_ledger(lab)
    _write_transactions(lab, told.states)
    _write_rows(lab, base, told)
    _write_entries(lab, told.states)
    left = rebuild_differences(lab)
    if left:
        raise ReconcileError(left[0].message, code="rebuild.stray", findings=left)


def restore(lab: Lab, document: bytes, events: Iterable[Event]) -> None:
    """Write a lab of which this database holds the row alone, from its import and its events.

    Raises:
        ReconcileError: The import or an event cannot be read.
        django.db.DatabaseError: The events break a rule of the ledger or the chain.

    Effect:
        None on matter. The caller rolls back when it fails.
    """
    sha256 = hashlib.sha256(document).hexdigest()
    packed = zlib.compress(document, level=1)
    LabBase.objects.create(lab=lab, document=packed, sha256=sha256)
    EventHead.objects.create(lab=lab)
    _in_chunks(Event, events)
    base, told = base_of(lab), replayed(lab)
    _write_transactions(lab, told.states)
    _write_rows(lab, base, told)
    _in_chunks(EventSubject, _subjects(lab))
    _write_entries(lab, told.states)


def _in_chunks(model: Any, rows: Iterable[Any]) -> None:  # noqa: ANN401 - any table
    left = iter(rows)
    while chunk := list(islice(left, _CHUNK)):
        model.objects.bulk_create(chunk)


def _subjects(lab: Lab) -> Iterator[EventSubject]:
    for event in events_in_order(lab):
        operation = operations.from_json(event.body["operation"])
        for resource_id, role in operations.subjects_of(operation):
            yield EventSubject(event=event, resource_id=resource_id, role=role)


def _empty_ledger(lab: Lab) -> None:
    with connection.cursor() as cursor:
        for statement in _EMPTY_LEDGER:
            cursor.execute(statement, [lab.pk] if "%s" in statement else None)


def _write_transactions(lab: Lab, states: dict[str, str]) -> None:
    """Give each transaction the state of its last event, and make those that are gone."""
    known = {str(pk): state for pk, state in _rows(lab).values_list("pk", "state")}
    wrong = {key: state for key, state in states.items() if known.get(key) != state}
    events = Event.objects.filter(transaction_id__in=list(wrong)).order_by("seq")
    last = {str(event.transaction_id): event for event in events}
    made = [_transaction(lab, event) for key, event in last.items() if key not in known]
    Transaction.objects.bulk_create(made)
    ended = [UUID(key) for key, state in wrong.items() if TransactionState(state) in FINAL]
    locks = ResourceLock.objects.filter(transaction__in=ended, released_at=None)
    locks.update(released_at=now())
    with connection.cursor() as cursor:
        cursor.execute("SET CONSTRAINTS ALL IMMEDIATE")
        cursor.execute("ALTER TABLE crutd_transaction DISABLE TRIGGER crutd_transaction_step")
        for key, state in ((key, state) for key, state in wrong.items() if key in known):
            change = last[key].body["change"]
            _rows(lab).filter(pk=key).update(state=state, change=change, settled_at=last[key].at)
        cursor.execute("ALTER TABLE crutd_transaction ENABLE TRIGGER crutd_transaction_step")
        cursor.execute("SET CONSTRAINTS ALL DEFERRED")


def _rows(lab: Lab) -> Any:  # noqa: ANN401 - a queryset
    return Transaction.objects.filter(lab=lab)


def _transaction(lab: Lab, event: Event) -> Transaction:
    body = event.body
    return Transaction(
        id=event.transaction_id,
        lab=lab,
        state=event.state,
        name=event.name,
        operation=body["operation"],
        actor_id=body.get("actor_id"),
        job_id=body.get("job_id"),
        proposed_at=event.at,
        settled_at=event.at,
        change=body["change"],
        verification=body.get("verification", ""),
        code=body.get("code", ""),
        message=body.get("message", ""),
    )


def _write_rows(lab: Lab, base: LabFile, told: Replay) -> None:
    nodes = list(told.nodes.values())
    imported = rows_of(lab, base)
    by_id = {row.id: row for row in imported.resources}
    tubes = {row.id: row for row in imported.connections}
    resource_services.rewrite(
        lab,
        [_resource(lab, node, by_id.get(node.id)) for node in _parents_first(nodes)],
        [
            tubes.get(key) or resource_services.connection_of(lab, link)
            for key, link in told.links.items()
        ],
        imported.materials,
        imported.lots,
    )
    for event in events_in_order(lab):
        operation = operations.from_json(event.body["operation"])
        if event.body["change"]["postings"]:
            resource_services.rewrite_lots(operation, lab)


def _parents_first(nodes: list[ReplayNode]) -> Iterator[ReplayNode]:
    below: dict[UUID | None, list[ReplayNode]] = {}
    for node in nodes:
        below.setdefault(node.parent_id, []).append(node)
    left = below.get(None, [])
    while left:
        yield from left
        left = [child for node in left for child in below.get(node.id, ())]


def _resource(lab: Lab, node: ReplayNode, imported: Resource | None) -> Resource:
    return Resource(
        id=node.id,
        lab=lab,
        parent_id=node.parent_id,
        key=node.key,
        name=node.name,
        kind=node.kind,
        nature=node.nature,
        position=node.position,
        config=dict(node.config),
        data=dict(node.data),
        pose=None if node.pose is None else dict(node.pose),
        rev=node.rev,
        quarantined_by=None if node.quarantined_by is None else UUID(node.quarantined_by),
        is_archived=node.is_archived,
        size_mm=None if imported is None else imported.size_mm,
        extra={} if imported is None else imported.extra,
    )


def _write_entries(lab: Lab, states: dict[str, str]) -> None:
    """Post what each event posted; the database keeps the balances and holds its rules."""
    _in_chunks(Entry, _entries(lab))
    doubtful = [key for key, state in states.items() if state == "quarantined"]
    for row in _rows(lab).filter(pk__in=doubtful):
        reserve(row, reservations(operations.from_json(row.operation)))


def _entries(lab: Lab) -> Iterator[Entry]:
    for event in events_in_order(lab):
        for plain in event.body["change"]["postings"]:
            posting = posting_from(plain)
            yield Entry(
                transaction_id=event.transaction_id,
                lot_id=UUID(posting.lot),
                debit=posting.debit,
                credit=posting.credit,
                amount_nl=posting.amount_nl,
                amount_ug=posting.amount_ug,
                state=Entry.State.POSTED,
                at=event.at,
            )
