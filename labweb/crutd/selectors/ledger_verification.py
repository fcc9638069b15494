"""Does the ledger hold? Every check reads the rows themselves and trusts no balance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from uuid import UUID

from django.db import connection

from labweb.domain.errors import Finding
from labweb.resources.selectors import Lab

_ENTRIES = """
WITH side AS (
    SELECT e.debit AS account, e.credit AS other, e.lot_id, e.state, -1 AS sign,
           e.amount_nl AS nl, e.amount_ug AS ug
    FROM crutd_entry e JOIN crutd_transaction t ON t.id = e.transaction_id
    WHERE t.lab_id = %(lab)s
    UNION ALL
    SELECT e.credit, e.debit, e.lot_id, e.state, 1, e.amount_nl, e.amount_ug
    FROM crutd_entry e JOIN crutd_transaction t ON t.id = e.transaction_id
    WHERE t.lab_id = %(lab)s
)
"""


@dataclass(frozen=True, slots=True)
class LedgerCheck:
    """One question to the rows; each row of the answer is a violation."""

    code: str
    sql: str
    message: str
    reads_entries: bool = False
    """The question is about `side`: each entry once for either account."""


CHECKS = (
    LedgerCheck(
        code="ledger.unbalanced",
        reads_entries=True,
        sql="""
        SELECT lot_id AS subject, sum(nl) AS nl, sum(ug) AS ug FROM (
            SELECT lot_id, sign * nl AS nl, sign * ug AS ug FROM side
            WHERE state = 'posted' AND account NOT LIKE '%%-%%'
            UNION ALL
            SELECT h.lot_id, h.amount_nl, h.amount_ug FROM crutd_holding h
            JOIN resources_resource r ON r.id = h.resource_id WHERE r.lab_id = %(lab)s
        ) AS account GROUP BY lot_id HAVING sum(nl) <> 0 OR sum(ug) <> 0
        """,
        message="lot {subject}: all accounts together are over by {nl} nL and {ug} µg",
    ),
    LedgerCheck(
        code="ledger.holding_differs",
        reads_entries=True,
        sql="""
        , told AS (
            SELECT account::uuid AS resource_id, lot_id, sum(sign * nl) AS nl, sum(sign * ug) AS ug
            FROM side WHERE state = 'posted' AND account LIKE '%%-%%' GROUP BY 1, 2
        ), kept AS (
            SELECT h.resource_id, h.lot_id, h.amount_nl AS nl, h.amount_ug AS ug
            FROM crutd_holding h JOIN resources_resource r ON r.id = h.resource_id
            WHERE r.lab_id = %(lab)s
        )
        SELECT resource_id AS subject, lot_id AS lot, kept.nl AS kept_nl, told.nl AS told_nl,
               kept.ug AS kept_ug, told.ug AS told_ug
        FROM told FULL JOIN kept USING (resource_id, lot_id)
        WHERE (coalesce(kept.nl, 0), coalesce(kept.ug, 0))
           <> (coalesce(told.nl, 0), coalesce(told.ug, 0))
        """,
        message=(
            "vessel {subject}, lot {lot}: the balance says {kept_nl} nL, {kept_ug} µg; "
            "the entries {told_nl} nL, {told_ug} µg"
        ),
    ),
    LedgerCheck(
        code="ledger.balance_differs",
        reads_entries=True,
        sql="""
        , told AS (
            SELECT account::uuid AS resource_id,
                coalesce(sum(sign * nl) FILTER (WHERE state = 'posted'), 0) AS posted_nl,
                coalesce(sum(sign * ug) FILTER (WHERE state = 'posted'), 0) AS posted_ug,
                coalesce(sum(CASE state WHEN 'pending' THEN nl ELSE -nl END)
                    FILTER (WHERE state <> 'posted' AND sign < 0), 0) AS out_nl,
                coalesce(sum(CASE state WHEN 'pending' THEN ug ELSE -ug END)
                    FILTER (WHERE state <> 'posted' AND sign < 0), 0) AS out_ug,
                coalesce(sum(CASE state WHEN 'pending' THEN nl ELSE -nl END)
                    FILTER (WHERE state <> 'posted' AND sign > 0), 0) AS in_nl,
                coalesce(sum(CASE state WHEN 'pending' THEN ug ELSE -ug END)
                    FILTER (WHERE state <> 'posted' AND sign > 0), 0) AS in_ug
            FROM side WHERE account LIKE '%%-%%' GROUP BY 1
        ), kept AS (
            SELECT b.* FROM crutd_balance b JOIN resources_resource r ON r.id = b.resource_id
            WHERE r.lab_id = %(lab)s
        )
        SELECT resource_id AS subject, kept.posted_nl AS kept_nl, told.posted_nl AS told_nl
        FROM told FULL JOIN kept USING (resource_id)
        WHERE (coalesce(kept.posted_nl, 0), coalesce(kept.posted_ug, 0),
               coalesce(kept.pending_out_nl, 0), coalesce(kept.pending_out_ug, 0),
               coalesce(kept.pending_in_nl, 0), coalesce(kept.pending_in_ug, 0))
           <> (coalesce(told.posted_nl, 0), coalesce(told.posted_ug, 0),
               coalesce(told.out_nl, 0), coalesce(told.out_ug, 0),
               coalesce(told.in_nl, 0), coalesce(told.in_ug, 0))
        """,
        message=(
            "vessel {subject}: what is posted or promised ({kept_nl} nL posted) is not what the "
            "entries say ({told_nl} nL posted)"
        ),
    ),
    LedgerCheck(
        code="ledger.overdrawn",
        sql="""
        SELECT b.resource_id AS subject, b.posted_nl AS nl, b.pending_out_nl AS out_nl
        FROM crutd_balance b JOIN resources_resource r ON r.id = b.resource_id
        WHERE r.lab_id = %(lab)s AND (b.posted_nl < b.pending_out_nl OR b.posted_nl < 0
            OR b.posted_ug < b.pending_out_ug OR b.posted_ug < 0 OR EXISTS (
                SELECT 1 FROM crutd_holding h WHERE h.resource_id = b.resource_id
                AND (h.amount_nl < 0 OR h.amount_ug < 0)))
        """,
        message="vessel {subject} holds {nl} nL and has promised {out_nl} nL",
    ),
    LedgerCheck(
        code="ledger.overfull",
        sql="""
        SELECT b.resource_id AS subject, b.posted_nl + b.pending_in_nl AS nl,
               b.posted_ug + b.pending_in_ug AS ug
        FROM crutd_balance b JOIN resources_resource r ON r.id = b.resource_id
        WHERE r.lab_id = %(lab)s AND crutd_is_overfull(
            r.config, b.posted_nl + b.pending_in_nl, b.posted_ug + b.pending_in_ug)
        """,
        message="vessel {subject} holds or awaits {nl} nL and {ug} µg, more than its capacity",
    ),
    LedgerCheck(
        code="ledger.unit",
        sql="""
        SELECT e.id AS subject, l.phase, l.id AS lot FROM crutd_entry e
        JOIN crutd_transaction t ON t.id = e.transaction_id
        JOIN resources_lot l ON l.id = e.lot_id
        WHERE t.lab_id = %(lab)s AND (l.phase = 'liquid') <> (e.amount_nl > 0)
        """,
        message="entry {subject} is not in the unit of lot {lot}, a {phase}",
    ),
    LedgerCheck(
        code="ledger.pending_left",
        sql="""
        SELECT e.transaction_id AS subject, t.state, min(e.id) AS entry FROM crutd_entry e
        JOIN crutd_transaction t ON t.id = e.transaction_id
        WHERE t.lab_id = %(lab)s AND t.state IN ('committed', 'rolled_back')
            AND e.state <> 'posted'
        GROUP BY e.transaction_id, t.state, e.debit, e.credit
        HAVING sum(CASE e.state WHEN 'pending' THEN e.amount_nl ELSE -e.amount_nl END) <> 0
            OR sum(CASE e.state WHEN 'pending' THEN e.amount_ug ELSE -e.amount_ug END) <> 0
        """,
        message="transaction {subject} is {state} and its entry {entry} still reserves an amount",
    ),
    LedgerCheck(
        code="ledger.lock_left",
        sql="""
        SELECT k.id AS subject, k.resource_id AS resource, t.id AS transaction, t.state
        FROM crutd_resourcelock k JOIN crutd_transaction t ON t.id = k.transaction_id
        WHERE t.lab_id = %(lab)s AND t.state IN ('committed', 'rolled_back')
            AND k.released_at IS NULL
        """,
        message="lock {subject} on {resource} is held by {transaction}, which is {state}",
    ),
    LedgerCheck(
        code="ledger.double_lock",
        sql="""
        SELECT k.id AS subject, k.resource_id AS resource, count(*) AS holders
        FROM crutd_resourcelock k JOIN crutd_transaction t ON t.id = k.transaction_id
        JOIN crutd_resourcelock o ON o.resource_id = k.resource_id AND o.released_at IS NULL
            AND o.transaction_id <> k.transaction_id
        WHERE t.lab_id = %(lab)s AND k.mode = 'X' AND k.released_at IS NULL
        GROUP BY k.id, k.resource_id
        """,
        message="lock {subject} is exclusive, and {holders} more hold {resource} or a part of it",
    ),
)


def ledger_violations(lab: Lab) -> list[Finding]:
    """List every way in which the ledger of a lab does not hold; an empty list means it does."""
    return [finding for check in CHECKS for finding in _ask(check, lab.id)]


def _ask(check: LedgerCheck, lab_id: UUID) -> Iterator[Finding]:
    with connection.cursor() as cursor:
        question = _ENTRIES + check.sql if check.reads_entries else check.sql
        cursor.execute(question, {"lab": lab_id})
        names = [column.name for column in cursor.description or ()]
        for values in cursor.fetchall():
            row = {name: _plain(value) for name, value in zip(names, values, strict=True)}
            yield Finding(check.code, check.message.format(**row), str(row["subject"]), row)


def _plain(value: object) -> int | str:
    """Render a cell: amounts as whole numbers, where none is none; ids as text."""
    if value is None:
        return 0
    return int(value) if isinstance(value, int | Decimal) else str(value)
