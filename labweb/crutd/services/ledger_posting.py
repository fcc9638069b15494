"""Rows of a transaction in the ledger: opened with locks and promises, posted, closed.

Written out, a statement each: they are on the way of every operation of the lab, and the ORM
would take longer than the database. The database keeps the balances.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import datetime
from typing import Any

from django.db import connection

from labweb.common.clock import happened_at, new_id
from labweb.common.database.prepared_queries import Question, together
from labweb.crutd.models import Entry, Transaction
from labweb.domain.crutd.ledger import Posting
from labweb.domain.crutd.reserved_amounts import Reservation
from labweb.domain.runs.exclusive_use.action_locks import Lock

_OPEN = """
WITH opened AS (
    INSERT INTO crutd_transaction (id, lab_id, state, name, operation, actor_id, job_id,
        batch_id, claims, proposed_at, conditions, verification, code, message)
    VALUES (%(id)s, %(lab)s, %(state)s, %(name)s, %(operation)s::jsonb, %(actor)s, %(job)s,
        %(batch)s, %(claims)s::jsonb, %(at)s, %(conditions)s::jsonb, '', '', '')
) {}
INSERT INTO crutd_resourcelock (id, resource_id, mode, transaction_id, taken_at)
SELECT lock_id, resource_id, mode, %(id)s, %(at)s
FROM unnest(%(lock_ids)s::uuid[], %(resource_ids)s::uuid[], %(modes)s::text[])
    AS taken(lock_id, resource_id, mode)
"""

_PROMISED = """, promised AS (
    INSERT INTO crutd_entry (transaction_id, debit, credit, amount_nl, amount_ug, state, at)
    SELECT %(id)s, debit, credit, amount_nl, amount_ug, %(pending)s, %(at)s
    FROM unnest(%(debits)s::text[], %(credits)s::text[], %(nl)s::bigint[], %(ug)s::bigint[])
        AS promise(debit, credit, amount_nl, amount_ug)
)"""

_ENTER = """
INSERT INTO crutd_entry
    (transaction_id, lot_id, debit, credit, amount_nl, amount_ug, state, at)
SELECT %s, lot_id, debit, credit, amount_nl, amount_ug, state, %s
FROM unnest(%s::uuid[], %s::text[], %s::text[], %s::bigint[], %s::bigint[], %s::text[])
    AS fresh(lot_id, debit, credit, amount_nl, amount_ug, state)
"""

_CLOSE = """
WITH released AS (
    UPDATE crutd_resourcelock SET released_at = %(settled_at)s
    WHERE transaction_id = %(id)s AND released_at IS NULL AND %(settled_at)s IS NOT NULL
)
UPDATE crutd_transaction SET state = %(state)s, change = %(change)s::jsonb,
    conditions = %(conditions)s::jsonb, verification = %(verification)s,
    code = %(code)s, message = %(message)s, settled_at = %(settled_at)s
WHERE id = %(id)s
"""


_VOID, _POSTED = Entry.State.VOID.value, Entry.State.POSTED.value


def open_transaction(
    row: Transaction, wanted: Sequence[Lock], promised: Sequence[Reservation]
) -> None:
    """Write a new transaction with every lock it takes and what it promises on both sides.

    One statement, before anything moves.

    Raises:
        django.db.IntegrityError: Another one holds a resource for itself: the last bar
            against two users of one thing.
    """
    together(opening(row, wanted, promised))


def opening(
    row: Transaction, wanted: Sequence[Lock], promised: Sequence[Reservation]
) -> Question[Any]:
    """Return the statement that does so, to be asked with others."""
    values: dict[str, Any] = {
        "id": row.id,
        "lab": row.lab_id,
        "state": row.state,
        "name": row.name,
        "operation": json.dumps(row.operation),
        "actor": row.actor_id,
        "job": row.job_id,
        "batch": row.batch_id,
        "claims": json.dumps(row.claims),
        "at": row.proposed_at,
        "conditions": json.dumps(row.conditions),
        "lock_ids": [new_id() for _ in wanted],
        "resource_ids": [lock.resource_id for lock in wanted],
        "modes": [lock.mode.value for lock in wanted],
        "pending": Entry.State.PENDING.value,
        "debits": [one.debit for one in promised],
        "credits": [one.credit for one in promised],
        "nl": [one.amount_nl for one in promised],
        "ug": [one.amount_ug for one in promised],
    }
    return Question(_OPEN.format(_PROMISED if promised else ""), values, tuple)


def reserve(row: Transaction, wanted: Sequence[Reservation]) -> None:
    """Promise amounts on both sides for a transaction that is written already."""
    state = Entry.State.PENDING.value
    _enter(
        row,
        row.proposed_at,
        [(None, one.debit, one.credit, one.amount_nl, one.amount_ug, state) for one in wanted],
    )


def post(row: Transaction, postings: Sequence[Posting], released: Sequence[Reservation]) -> None:
    """Release what was reserved and write what moved, in one statement."""
    lines = [
        *((None, one.debit, one.credit, one.amount_nl, one.amount_ug, _VOID) for one in released),
        *((p.lot, p.debit, p.credit, p.amount_nl, p.amount_ug, _POSTED) for p in postings),
    ]
    _enter(row, happened_at(), lines)


def _enter(row: Transaction, at: datetime, lines: Sequence[tuple[Any, ...]]) -> None:
    if not lines:
        return
    columns = [list(column) for column in zip(*lines, strict=True)]
    with connection.cursor() as cursor:
        cursor.execute(_ENTER, [row.id, at, *columns])


def close_transaction(row: Transaction) -> None:
    """Write how a transaction stands, and release its locks where it has ended."""
    with connection.cursor() as cursor:
        cursor.execute(
            _CLOSE,
            {
                "id": row.id,
                "state": row.state,
                "change": json.dumps(row.change),
                "conditions": json.dumps(row.conditions),
                "verification": row.verification,
                "code": row.code,
                "message": row.message,
                "settled_at": row.settled_at,
            },
        )
