"""A ledger and a chain that were tampered with say which row it was."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from io import StringIO
from pathlib import Path
from uuid import UUID

import pytest
from django.core.management import CommandError, call_command
from django.db import connection

from labweb.crutd.models import Balance, Entry, Event, EventHead, Holding, ResourceLock
from labweb.crutd.selectors.event_chain import first_broken_event
from labweb.crutd.selectors.ledger_verification import CHECKS, ledger_violations
from labweb.crutd.services import Settlement, lock_operation, settle
from labweb.domain.crutd.operations import Update
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from tests.builders import Bench, a_started_run, an_edge, to_transfer


@contextmanager
def rules_off() -> Iterator[None]:
    """Write as somebody with the keys to the database: no trigger and no constraint looks."""
    with connection.cursor() as cursor:
        cursor.execute("SET CONSTRAINTS ALL IMMEDIATE")
        cursor.execute("SET session_replication_role = replica")
        yield
        cursor.execute("SET session_replication_role = origin")


def tamper(sql: str, *params: str | int | UUID | list[int] | None) -> None:
    with rules_off(), connection.cursor() as cursor:
        cursor.execute(sql, params)
        assert cursor.rowcount, "nothing was tampered with"


def run(command: str, *arguments: str) -> tuple[int, str]:
    out = StringIO()
    try:
        call_command(command, *arguments, stdout=out)
    except CommandError as error:
        return error.returncode, out.getvalue()
    return 0, out.getvalue()


@pytest.fixture
def worked(bench: Bench) -> Bench:
    """A lab in which 5 mL of water were moved."""
    an_edge(bench).work_off(a_started_run(bench))
    return bench


@pytest.fixture
def loose(worked: Bench) -> Bench:
    """The same, without the constraints that would refuse to be broken."""
    with connection.cursor() as cursor:
        cursor.execute("SET CONSTRAINTS ALL IMMEDIATE")
        for table, name in (
            ("holding", "holding_not_negative"),
            ("balance", "balance_never_overdrawn"),
        ):
            cursor.execute(f"ALTER TABLE crutd_{table} DROP CONSTRAINT {name}")
    return worked


def codes(bench: Bench) -> set[str]:
    return {finding.code for finding in ledger_violations(bench.lab)}


def a_holding() -> Holding:
    return Holding.objects.filter(amount_nl__gt=1_000_000).order_by("id")[0]


def test_an_untouched_ledger_holds(worked: Bench) -> None:
    assert ledger_violations(worked.lab) == []
    assert run("verify_ledger") == (0, f"{worked.lab.key}: holds\n")


def test_an_edited_balance_is_named(worked: Bench) -> None:
    held = a_holding()
    tamper("UPDATE crutd_holding SET amount_nl = amount_nl - 1 WHERE id = %s", held.id)
    found = {finding.code: finding for finding in ledger_violations(worked.lab)}
    assert found.keys() == {"ledger.unbalanced", "ledger.holding_differs"}
    assert found["ledger.holding_differs"].subject == str(held.resource_id)
    assert found["ledger.unbalanced"].subject == str(held.lot_id)
    assert found["ledger.unbalanced"].context["nl"] == -1


def test_an_edited_entry_is_named(worked: Bench) -> None:
    entry = Entry.objects.filter(state="posted").exclude(debit="RECEIPT").order_by("id")[0]
    tamper("UPDATE crutd_entry SET amount_nl = amount_nl + 1 WHERE id = %s", entry.id)
    subjects = {finding.subject for finding in ledger_violations(worked.lab)}
    assert {entry.debit, entry.credit} <= subjects


def test_a_deleted_receipt_is_named(worked: Bench) -> None:
    entry = Entry.objects.filter(debit="RECEIPT").order_by("id")[0]
    tamper("DELETE FROM crutd_entry WHERE id = %s", entry.id)
    assert "ledger.unbalanced" in codes(worked)


def test_a_promise_more_than_there_is_is_named(loose: Bench) -> None:
    vessel = a_holding().resource_id
    tamper("UPDATE crutd_balance SET pending_out_nl = posted_nl + 1 WHERE resource_id = %s", vessel)
    assert codes(loose) == {"ledger.balance_differs", "ledger.overdrawn"}


def test_a_negative_balance_is_named(loose: Bench) -> None:
    tamper("UPDATE crutd_holding SET amount_nl = -1 WHERE id = %s", a_holding().id)
    assert "ledger.overdrawn" in codes(loose)


def test_an_overfull_vessel_is_named(worked: Bench) -> None:
    vessel = a_holding().resource_id
    config = '{"capacity_ul": 1}'
    tamper("UPDATE resources_resource SET config = %s WHERE id = %s", config, vessel)
    assert codes(worked) == {"ledger.overfull"}


def test_an_entry_in_the_wrong_unit_is_named(worked: Bench) -> None:
    entry = Entry.objects.filter(state="posted").order_by("id")[0]
    tamper("UPDATE resources_lot SET phase = 'solid' WHERE id = %s", entry.lot_id)
    assert codes(worked) == {"ledger.unit"}


def test_a_reservation_of_an_ended_transaction_is_named(worked: Bench) -> None:
    void = Entry.objects.filter(state="void").order_by("id")[0]
    tamper("DELETE FROM crutd_entry WHERE id = %s", void.id)
    assert codes(worked) == {"ledger.pending_left", "ledger.balance_differs"}


def test_a_lock_of_an_ended_transaction_is_named(worked: Bench) -> None:
    lock = ResourceLock.objects.order_by("id")[0]
    tamper("UPDATE crutd_resourcelock SET released_at = NULL WHERE id = %s", lock.id)
    found = ledger_violations(worked.lab)
    assert [(one.code, one.subject) for one in found] == [("ledger.lock_left", str(lock.id))]


def test_two_holders_of_one_resource_are_named(bench: Bench) -> None:
    attempt = to_transfer(a_started_run(bench), an_edge(bench))
    lock = ResourceLock.objects.filter(transaction=attempt.transaction, mode="X")[0]
    other = ResourceLock.objects.exclude(transaction=attempt.transaction)[0]
    tamper(
        "UPDATE crutd_resourcelock SET released_at = NULL, mode = 'IX', resource_id = %s"
        " WHERE id = %s",
        lock.resource_id,
        other.id,
    )
    assert "ledger.double_lock" in codes(bench)


def test_every_check_has_a_test_that_breaks_it() -> None:
    source = Path(__file__).read_text("utf-8")
    assert all(check.code in source for check in CHECKS)


def test_the_command_lists_each_violation_and_fails(worked: Bench) -> None:
    tamper("UPDATE crutd_holding SET amount_nl = amount_nl - 1 WHERE id = %s", a_holding().id)
    code, text = run("verify_ledger")
    assert code == 1
    assert "ledger.holding_differs: vessel" in text
    code, text = run("verify_ledger", "--json")
    told = json.loads(text)
    assert (code, told["holds"]) == (1, False)
    assert len(told["labs"][worked.lab.key]) == 2


def middle() -> Event:
    return Event.objects.get(seq=Event.objects.count() // 2)


def broken(bench: Bench) -> tuple[str, str]:
    found = first_broken_event(bench.lab)
    assert found is not None
    return found.code, found.subject


def test_an_untouched_chain_is_whole(worked: Bench) -> None:
    assert first_broken_event(worked.lab) is None
    assert run("verify_events") == (0, f"{worked.lab.key}: whole\n")


EDITS = {
    "body": "UPDATE crutd_event SET body = jsonb_set(body, '{message}', '\"x\"') WHERE id = %s",
    "time": "UPDATE crutd_event SET at = at + interval '1 second' WHERE id = %s",
    "hash": "UPDATE crutd_event SET hash = md5(hash) WHERE id = %s",
}


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
def test_an_edited_event_is_named(worked: Bench, edit: str) -> None:
    event = middle()
    tamper(edit, event.id)
    assert broken(worked) == ("events.edited", str(event.seq))


@pytest.mark.parametrize("column", ["state = 'quarantined'", "name = 'delete'"])
def test_a_column_that_says_other_than_the_body_is_named(worked: Bench, column: str) -> None:
    event = middle()
    tamper(f"UPDATE crutd_event SET {column} WHERE id = %s", event.id)
    assert broken(worked) == ("events.columns", str(event.seq))


def test_an_event_about_other_resources_is_named(worked: Bench) -> None:
    event = Event.objects.filter(subjects__role="target").order_by("seq")[0]
    tamper("DELETE FROM crutd_eventsubject WHERE event_id = %s AND role = 'target'", event.id)
    assert broken(worked) == ("events.columns", str(event.seq))


def delete(events: list[int]) -> None:
    tamper("DELETE FROM crutd_eventsubject WHERE event_id = ANY(%s)", events)
    tamper("DELETE FROM crutd_event WHERE id = ANY(%s)", events)


def test_a_deleted_event_is_named(worked: Bench) -> None:
    event = Event.objects.filter(subjects__isnull=False, seq__gt=2).order_by("seq")[0]
    delete([event.id])
    assert broken(worked) == ("events.missing", str(event.seq))


def test_exchanged_events_are_named(worked: Bench) -> None:
    event = middle()
    tamper(
        "UPDATE crutd_event SET seq = seq + 1000 WHERE seq IN (%s, %s + 1)", event.seq, event.seq
    )
    tamper("UPDATE crutd_event SET seq = 2 * %s + 1001 - seq WHERE seq > 1000", event.seq)
    assert broken(worked) == ("events.reordered", str(event.seq))


def test_the_loss_of_the_last_events_is_seen(worked: Bench) -> None:
    last = Event.objects.filter(subjects__isnull=False).order_by("-seq")[0]
    gone = list(Event.objects.filter(seq__gte=last.seq).values_list("id", flat=True))
    delete(gone)
    assert broken(worked) == ("events.truncated", str(last.seq))


def test_the_loss_of_the_end_itself_is_seen(worked: Bench) -> None:
    tamper("DELETE FROM crutd_eventhead WHERE lab_id = %s", worked.lab.id)
    assert broken(worked)[0] == "events.no_head"


@pytest.mark.parametrize(
    "edit",
    ["SET document = '\\x00'", "SET document = convert_to('x', 'UTF8')", "SET sha256 = 'x'"],
)
def test_an_edited_base_is_seen(worked: Bench, edit: str) -> None:
    tamper(f"UPDATE crutd_labbase {edit} WHERE lab_id = %s", worked.lab.id)
    assert broken(worked)[0] == "events.base"


def test_the_command_names_the_first_broken_event_and_fails(worked: Bench) -> None:
    event = middle()
    tamper(EDITS["body"], event.id)
    code, text = run("verify_events")
    assert (code, f"event {event.seq} (row {event.id}) was edited" in text) == (1, True)
    code, text = run("verify_events", "--json")
    assert (code, json.loads(text)["whole"]) == (1, False)


def test_the_head_moves_with_the_events(worked: Bench) -> None:
    last = Event.objects.order_by("-seq")[0]
    head = EventHead.objects.get()
    assert (head.seq, head.hash) == (last.seq, last.hash)
    assert Balance.objects.count() > 1


# --- what a device or a person wrote is not tampering ---


@pytest.mark.parametrize("told", [-0.0, 1e16, -2.5e300, 1e-9, 100.0])
def test_a_number_that_the_database_writes_in_another_way_was_not_edited(
    worked: Bench, told: float, tmp_path: Path
) -> None:
    """A tared balance reads -0.0: the event that says so fits its hash, and can be exported."""
    row = lock_operation(
        Update(resource_id=worked.node("balance_1").id, data={"is_tared": True}),
        lab=worked.lab,
        targets=(),
        actor_id=None,
    )
    outcome = Outcome(kind=OutcomeKind.DONE, data={"mass_mg": told})
    settle(row.id, Settlement(outcome=outcome))
    assert first_broken_event(worked.lab) is None
    assert run("export_events", str(tmp_path / "events"))[0] == 0


def test_what_a_host_told_keeps_its_hash_in_the_database(bench: Bench, tmp_path: Path) -> None:
    edge = an_edge(bench)
    attempt = to_transfer(a_started_run(bench), edge)
    edge.begin(attempt)
    edge.report("actuated", attempt.id, report={"mass_mg": -0.0, "ticks": 1e16})
    edge.finish(attempt)
    edge.work_off(attempt.job.run)
    assert run("export_events", str(tmp_path / "events"))[0] == 0
