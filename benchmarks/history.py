"""A long history made quickly: rows as the services write them, by COPY.

Foreign keys and triggers are off while the rows are copied, or a million events would take an
hour. What the triggers keep (balances, the end of the chain) is written from the entries after,
and `verified` asks the product's own checkers whether all of it is what services would have
left.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from uuid import UUID

from django.db import connection
from django.db.transaction import atomic

from labweb.crutd.models import EventHead
from labweb.crutd.selectors.event_chain import event_hash, first_broken_event
from labweb.crutd.selectors.ledger_verification import ledger_violations
from labweb.domain.canonical_json import canonical
from labweb.resources.selectors import Lab, Lot

DEPTH = 50
"""Transfers from the delivery to the sample."""

PER_ROUND = DEPTH + 2
"""A delivery, the transfers, and the sample poured away before the next round."""

AMOUNT_NL = 100_000
_BATCH = 20_000
_BEGAN = datetime(2026, 1, 1, tzinfo=UTC)

_TABLES = {
    "resources_lot": "id, lab_id, key, material_id, supplier, number, purity, phase, position",
    "crutd_transaction": "id, lab_id, state, name, operation, proposed_at, settled_at, conditions,"
    " claims, change, verification, code, message",
    "crutd_event": "id, lab_id, seq, at, transaction_id, name, state, body, prev_hash, hash,"
    " is_bounded",
    "crutd_eventsubject": "event_id, resource_id, role",
    "crutd_entry": "transaction_id, lot_id, debit, credit, amount_nl, amount_ug, state, at",
}

_BALANCES = """
INSERT INTO crutd_holding (resource_id, lot_id, amount_nl, amount_ug)
SELECT account::uuid, lot_id, sum(nl), 0 FROM (
    SELECT credit AS account, lot_id, amount_nl AS nl FROM crutd_entry
    WHERE state = 'posted' AND credit LIKE '%-%'
    UNION ALL
    SELECT debit, lot_id, -amount_nl FROM crutd_entry WHERE state = 'posted' AND debit LIKE '%-%'
) AS side GROUP BY 1, 2;
INSERT INTO crutd_balance (resource_id, posted_nl, posted_ug, pending_out_nl, pending_out_ug,
    pending_in_nl, pending_in_ug)
SELECT resource_id, sum(amount_nl), 0, 0, 0, 0, 0 FROM crutd_holding GROUP BY 1;
SELECT setval(pg_get_serial_sequence('crutd_event', 'id'), max(id)) FROM crutd_event;
"""


@dataclass(frozen=True, slots=True)
class Act:
    """One of the million: what enters or leaves a vessel, or goes from one to the next."""

    lot: str
    debit: str
    credit: str


@dataclass
class _Pages:
    """Lines on their way into the tables."""

    lines: dict[str, list[str]] = field(default_factory=lambda: {name: [] for name in _TABLES})

    def add(self, table: str, *values: object) -> None:
        self.lines[table].append("\t".join(map(str, values)) + "\n")

    def flush(self) -> None:
        with connection.cursor() as cursor:
            for table, columns in _TABLES.items():
                with cursor.copy(f"COPY {table} ({columns}) FROM STDIN") as copy:
                    copy.write("".join(self.lines[table]))
                self.lines[table].clear()


@atomic
def make_history(lab: Lab, lines: Sequence[Sequence[UUID]], rounds: int) -> int:
    """Send deliveries through each line of vessels, again and again, all lines in turns.

    Each line is used `rounds` times: a delivery into the first vessel, all of it on through
    the others, the last one emptied; after the last round it keeps its sample.

    Returns:
        How many events there are.
    """
    head = EventHead.objects.get(lab=lab)
    material = Lot.objects.filter(lab=lab)[0].material_id
    pages, seq, prev = _Pages(), head.seq, head.hash
    with connection.cursor() as cursor:
        cursor.execute("SET LOCAL session_replication_role = replica")
        cursor.execute("DELETE FROM crutd_holding; DELETE FROM crutd_balance")
        for act in _acts(pages, lab, material, lines, rounds):
            seq += 1
            prev = _write(pages, lab, act, seq, prev)
            if seq % _BATCH == 0:
                pages.flush()
        pages.flush()
        cursor.execute("UPDATE crutd_eventhead SET seq = %s, hash = %s", [seq, prev])
        cursor.execute(_BALANCES)
        cursor.execute("SET LOCAL session_replication_role = DEFAULT")
    return seq


def analyze() -> None:
    """Have the planner know the tables, as autovacuum does in time."""
    with connection.cursor() as cursor:
        cursor.execute("VACUUM ANALYZE")


def verified(lab: Lab) -> bool:
    """Tell whether the ledger and the chain of events hold."""
    return not ledger_violations(lab) and first_broken_event(lab) is None


def _acts(
    pages: _Pages, lab: Lab, material: UUID, lines: Sequence[Sequence[UUID]], rounds: int
) -> Iterator[Act]:
    for turn in range(rounds):
        lots = [_uuid(0xA, turn * len(lines) + number) for number in range(len(lines))]
        for number, lot in enumerate(lots):
            key = f"delivery {turn}/{number}"
            place = turn * len(lines) + number + 1
            pages.add("resources_lot", lot, lab.id, key, material, "", key, "", "liquid", place)
        for step in range(PER_ROUND):
            for lot, line in zip(lots, lines, strict=True):
                if step == 0:
                    yield Act(lot, "RECEIPT", str(line[0]))
                elif step <= DEPTH:
                    yield Act(lot, str(line[step - 1]), str(line[step]))
                elif turn < rounds - 1:
                    yield Act(lot, str(line[DEPTH]), "WASTE")


def _uuid(sort: int, number: int) -> str:
    """Return an id that sorts by the number, as those of transactions sort by time."""
    digits = f"{sort:08x}{number:024x}"
    return f"{digits[:8]}-{digits[8:12]}-{digits[12:16]}-{digits[16:20]}-{digits[20:]}"


def _write(pages: _Pages, lab: Lab, act: Act, seq: int, prev: str) -> str:
    """Add the rows of one settled transaction; return the hash of its event."""
    own = _uuid(0xB, seq)
    at = (_BEGAN + timedelta(seconds=seq)).isoformat()
    name, operation, subjects = _operation(act)
    posting = {"lot": act.lot, "debit": act.debit, "credit": act.credit, "amount_nl": AMOUNT_NL}
    change = _CHANGE | {"postings": [posting]}
    body = _BODY | {"operation": operation, "change": change}
    digest = event_hash(prev, seq, at, own, body)
    plain, told = _json(operation), _json(change)
    pages.add(
        "crutd_transaction",
        *(own, lab.id, "committed", name, plain, at, at, "[]", "[]", told, "assumed", "", ""),
    )
    event = (seq, lab.id, seq, at, own, name, "committed", _json(body), prev, digest, False)
    pages.add("crutd_event", *event)
    for resource, role in subjects:
        pages.add("crutd_eventsubject", seq, resource, role)
    if len(subjects) > 1:
        for state in ("pending", "void"):
            pages.add("crutd_entry", own, r"\N", act.debit, act.credit, AMOUNT_NL, 0, state, at)
    pages.add("crutd_entry", own, act.lot, act.debit, act.credit, AMOUNT_NL, 0, "posted", at)
    return digest


def _json(value: object) -> str:
    return canonical(value).decode()


_EMPTY = ("archived", "quarantined", "created", "restored", "released")
_CHANGE = {"state": "committed", "data": {}, "moves": {}} | {name: [] for name in _EMPTY}
_BODY = {"verification": "assumed", "code": "", "message": "", "job_id": None, "actor_id": None}


def _operation(act: Act) -> tuple[str, dict[str, object], list[tuple[str, str]]]:
    """Return name, operation and subjects as the services would."""
    if act.debit == "RECEIPT":
        portion = {"resource_id": act.credit, "amount_nl": AMOUNT_NL, "amount_ug": 0}
        receive: dict[str, object] = {
            "op": "receive",
            "lot_id": act.lot,
            "material_id": act.lot,
            "key": act.lot,
        }
        receive |= {"phase": "liquid", "portions": [portion]}
        return "create", receive, [(act.credit, "target")]
    if act.credit == "WASTE":
        return "transfer", {"op": "dispose", "resource_id": act.debit}, [(act.debit, "source")]
    poured: dict[str, object] = {"op": "transfer_liquid", "amount_nl": AMOUNT_NL}
    poured |= {"source_id": act.debit, "target_id": act.credit}
    return "transfer", poured, [(act.debit, "source"), (act.credit, "target")]
