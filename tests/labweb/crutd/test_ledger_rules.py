"""What the database itself refuses, whoever writes."""

from __future__ import annotations

from typing import Any

import pytest
from django.db import DatabaseError, connection
from django.db.models import Sum
from django.db.transaction import atomic

from labweb.crutd import services
from labweb.crutd.models import (
    Balance,
    Entry,
    Event,
    EventHead,
    Holding,
    LabBase,
    ResourceLock,
    Transaction,
)
from labweb.crutd.selectors.ledger_verification import ledger_violations
from labweb.domain.crutd import operations
from labweb.resources.models import Lot, Resource
from tests.builders import Bench, a_started_run, an_edge, to_transfer

SUM = {"posted_nl": Sum("posted_nl"), "out": Sum("pending_out_nl"), "come": Sum("pending_in_nl")}


def entry(bench: Bench, debit: str, credit: str, amount_nl: int, **fields: Any) -> Entry:  # noqa: ANN401
    accounts = [str(bench.node(name).id) if name.islower() else name for name in (debit, credit)]
    held = Holding.objects.filter(resource=bench.node("water"))[0]
    values = {"state": "posted", "lot_id": held.lot_id} | fields
    about = Transaction.objects.order_by("-proposed_at")[0]
    return Entry.objects.create(
        transaction=about,
        debit=accounts[0],
        credit=accounts[1],
        amount_nl=amount_nl,
        at=about.proposed_at,
        **values,
    )


def refused(bench: Bench, match: str, *args: Any, **fields: Any) -> None:  # noqa: ANN401
    before = list(Holding.objects.order_by("id").values())
    with pytest.raises(DatabaseError, match=match), atomic():
        entry(bench, *args, **fields)
    assert list(Holding.objects.order_by("id").values()) == before


def pending(bench: Bench) -> None:
    """Have a live transaction to reserve for."""
    operation = operations.Update(resource_id=bench.node("bench_1").id, data={})
    services.lock_operation(operation, lab=bench.lab, targets=[], actor_id=None)


def test_an_entry_moves_both_balances(bench: Bench) -> None:
    water = Balance.objects.get(resource=bench.node("water")).posted_nl
    entry(bench, "water", "flask_1", 1_000)
    assert Balance.objects.get(resource=bench.node("water")).posted_nl == water - 1_000
    assert Holding.objects.get(resource=bench.node("flask_1")).amount_nl == 1_000
    assert ledger_violations(bench.lab) == []


def test_a_vessel_never_gives_more_than_it_holds(bench: Bench) -> None:
    held = Holding.objects.get(resource=bench.node("water")).amount_nl
    refused(bench, "holding_not_negative", "water", "LOSS", held + 1)


def test_an_empty_vessel_gives_nothing(bench: Bench) -> None:
    refused(bench, "holding_not_negative", "flask_1", "LOSS", 1)


def test_a_vessel_never_takes_more_than_its_capacity(bench: Bench) -> None:
    capacity = bench.node("flask_1").config["capacity_ul"] * 1000
    entry(bench, "RECEIPT", "flask_1", capacity)
    refused(bench, "more than its capacity", "RECEIPT", "flask_1", 1)


def test_a_capacity_is_never_set_below_what_a_vessel_holds(bench: Bench) -> None:
    with pytest.raises(DatabaseError, match="more than this capacity"), atomic():
        Resource.objects.filter(key="water").update(config={"capacity_ul": 1})


@pytest.mark.parametrize("amounts", [(0, 0), (1, 1), (-1, 0), (0, -1)])
def test_an_entry_has_one_positive_amount(bench: Bench, amounts: tuple[int, int]) -> None:
    refused(bench, "entry_one_unit|unit of", "water", "LOSS", amounts[0], amount_ug=amounts[1])


@pytest.mark.parametrize("account", ["STOCK", "receipt-1", ""])
def test_an_account_is_a_vessel_or_on_the_list(bench: Bench, account: str) -> None:
    with pytest.raises(DatabaseError), atomic():
        Entry.objects.create(
            transaction=Transaction.objects.get(),
            lot=Lot.objects.all()[0],
            debit="RECEIPT",
            credit=account,
            amount_nl=1,
            state="posted",
            at=Transaction.objects.get().proposed_at,
        )


def test_an_entry_is_in_the_unit_of_its_lot(bench: Bench) -> None:
    refused(bench, "not in the unit", "RECEIPT", "flask_1", 0, amount_ug=5)
    Lot.objects.update(phase="solid")
    refused(bench, "not in the unit", "RECEIPT", "flask_1", 5)
    entry(bench, "RECEIPT", "flask_1", 0, amount_ug=5)


def test_no_more_is_promised_than_is_there(bench: Bench) -> None:
    pending(bench)
    water = Balance.objects.get(resource=bench.node("water")).posted_nl
    dead = (bench.node("water").config.get("dead_volume_ul") or 0) * 1000
    give: dict[str, Any] = {"state": "pending", "lot_id": None}
    entry(bench, "water", "WASTE", water - dead - 10, **give)
    refused(bench, "dead volume|overdrawn", "water", "WASTE", 11, **give)
    entry(bench, "water", "WASTE", 10, **give)


def test_room_that_is_promised_is_not_promised_again(bench: Bench) -> None:
    pending(bench)
    capacity = bench.node("flask_1").config["capacity_ul"] * 1000
    entry(bench, "RECEIPT", "flask_1", capacity - 5, state="pending", lot_id=None)
    refused(bench, "more than its capacity", "RECEIPT", "flask_1", 6)


def test_nothing_is_reserved_for_a_transaction_that_has_ended(bench: Bench) -> None:
    refused(bench, "has ended", "water", "flask_1", 1, state="pending", lot_id=None)


def test_nothing_is_released_that_was_not_reserved(bench: Bench) -> None:
    pending(bench)
    refused(bench, "overdrawn|pending_in", "water", "flask_1", 1, state="void", lot_id=None)


@pytest.mark.parametrize("table", ["crutd_holding", "crutd_balance"])
@pytest.mark.parametrize("change", ["UPDATE {} SET resource_id = resource_id", "DELETE FROM {}"])
def test_only_entries_change_a_balance(bench: Bench, table: str, change: str) -> None:
    del bench
    with pytest.raises(DatabaseError, match="ledger alone"), atomic():
        connection.cursor().execute(change.format(table))


def test_a_reservation_is_gone_when_its_transaction_is(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = to_transfer(run, edge)
    asked = attempt.job.operation["amount_nl"]
    sums = Balance.objects.aggregate(**SUM)
    assert (sums["out"], sums["come"]) == (asked, asked)
    edge.complete(attempt)
    sums = Balance.objects.aggregate(**SUM)
    assert (sums["out"], sums["come"]) == (0, 0)


@pytest.mark.parametrize("state", ["proposed", "locked", "executing", "rolled_back", "quarantined"])
def test_a_final_transaction_stays_as_it_is(bench: Bench, state: str) -> None:
    del bench
    with pytest.raises(DatabaseError, match="cannot go from committed"), atomic():
        Transaction.objects.update(state=state)


@atomic
def end_locked() -> None:
    """Roll back what is locked, and have the database check it as at a commit."""
    Transaction.objects.filter(state="locked").update(state="rolled_back")
    with connection.cursor() as cursor:
        cursor.execute("SET CONSTRAINTS ALL IMMEDIATE")
        cursor.execute("SET CONSTRAINTS ALL DEFERRED")


def test_a_transaction_does_not_end_with_a_lock(bench: Bench) -> None:
    pending(bench)
    with pytest.raises(DatabaseError, match="holds a lock"):
        end_locked()
    ResourceLock.objects.update(released_at="2026-01-01T00:00:00Z")
    end_locked()


def test_a_transaction_does_not_end_with_a_reservation(bench: Bench) -> None:
    to_transfer(a_started_run(bench), an_edge(bench))
    ResourceLock.objects.update(released_at="2026-01-01T00:00:00Z")
    with pytest.raises(DatabaseError, match="reserves an amount"):
        end_locked()


@pytest.mark.parametrize(("step", "prev"), [(2, None), (0, None), (1, "x")])
def test_an_event_that_does_not_follow_is_refused(
    bench: Bench, step: int, prev: str | None
) -> None:
    head = EventHead.objects.get()
    with pytest.raises(DatabaseError, match="does not follow"), atomic():
        Event.objects.create(
            lab=bench.lab,
            seq=head.seq + step,
            at=Transaction.objects.get().proposed_at,
            transaction=Transaction.objects.get(),
            name="read",
            state="committed",
            body={},
            prev_hash=head.hash if prev is None else prev,
            hash="y",
        )


@pytest.mark.parametrize("model", [EventHead, LabBase])
def test_the_end_of_the_chain_and_its_base_are_not_edited(
    bench: Bench, model: type[EventHead | LabBase]
) -> None:
    del bench
    table = model._meta.db_table
    for change in (f"UPDATE {table} SET lab_id = lab_id", f"DELETE FROM {table}"):
        with pytest.raises(DatabaseError, match="append-only"), atomic():
            connection.cursor().execute(change)
