"""Tree, ledger and states come back from the events when their rows are wrong or gone."""

from __future__ import annotations

from io import StringIO
from typing import Any

import pytest
from django.core.management import CommandError, call_command

from labweb.crutd.models import Balance, Entry, Holding, Transaction
from labweb.crutd.selectors.ledger_verification import ledger_violations
from labweb.records.services import ledger_rebuild
from labweb.resources.models import Connection, Lot, Material, Resource
from labweb.runs.models import Job
from tests.builders import Bench, a_started_run, an_edge, dispatched, to_transfer
from tests.labweb.crutd.hand import a_jar
from tests.labweb.crutd.test_rebuild import move
from tests.labweb.crutd.test_verify import tamper
from tests.labweb.records.test_provenance import done, pour

TABLES = (
    "crutd_entry", "crutd_holding", "crutd_balance", "resources_connection", "resources_lot",
    "resources_material", "resources_resource",
)  # fmt: skip


def state(bench: Bench) -> dict[str, Any]:
    """Return all that a rebuild has to bring back, beside numbers that the database gives."""
    tree = Resource.objects.filter(lab=bench.lab).order_by("id")
    held = Holding.objects.exclude(amount_nl=0, amount_ug=0).order_by("resource_id", "lot_id")
    posted = Entry.objects.filter(state="posted").order_by("transaction_id", "debit", "credit")
    return {
        "tree": list(tree.values()),
        "lots": list(Lot.objects.order_by("id").values()),
        "materials": list(Material.objects.order_by("id").values()),
        "connections": list(Connection.objects.order_by("id").values()),
        "held": list(held.values_list("resource_id", "lot_id", "amount_nl", "amount_ug")),
        "balances": list(Balance.objects.exclude(posted_nl=0, posted_ug=0).order_by("pk").values()),
        "posted": list(posted.values_list("transaction_id", "debit", "credit", "amount_nl")),
        "transactions": list(Transaction.objects.order_by("id").values_list("id", "state")),
        "jobs": list(Job.objects.order_by("id").values_list("id", "state")),
    }


def a_history(bench: Bench) -> None:
    """Do a run, pour and carry by hand, and leave a doubt behind."""
    edge = an_edge(bench)
    edge.work_off(a_started_run(bench))
    pour(bench, "reactor_1", "flask_1", 1_000_000)
    a_jar(bench, "jar")
    move(bench, "jar", "lab")
    edge.lose(to_transfer(a_started_run(bench), edge))


def test_a_lab_comes_back_whole_when_every_row_of_it_is_gone(bench: Bench) -> None:
    a_history(bench)
    before = state(bench)
    assert ledger_rebuild.differences(bench.lab) == []
    for table in TABLES:
        tamper(f"DELETE FROM {table}")
    tamper("UPDATE crutd_transaction SET state = 'committed'")
    tamper("UPDATE runs_job SET state = 'queued'")
    assert ledger_rebuild.differences(bench.lab) != []
    out = StringIO()
    call_command("rebuild", stdout=out, stderr=StringIO())
    assert "equal" in out.getvalue()
    assert state(bench) == before
    assert ledger_violations(bench.lab) == []


@pytest.mark.parametrize(
    "sql",
    [
        "UPDATE resources_resource SET name = 'Other', rev = 99 WHERE key = 'water'",
        "UPDATE resources_resource SET key = 'x' WHERE key = 'water'",
        "UPDATE crutd_entry SET amount_nl = 7 WHERE state = 'posted'",
        "UPDATE crutd_holding SET amount_nl = amount_nl + 1",
        "UPDATE crutd_transaction SET state = 'rolled_back' WHERE state = 'committed'",
        "UPDATE runs_job SET state = 'aborted' WHERE state = 'complete'",
    ],
)
def test_a_row_that_was_tampered_with_is_put_right(bench: Bench, sql: str) -> None:
    done(bench)
    before = state(bench)
    tamper(sql)
    assert ledger_rebuild.differences(bench.lab) != []
    ledger_rebuild.rebuild(bench.lab)
    assert state(bench) == before
    assert ledger_violations(bench.lab) == []


def test_a_lab_with_something_under_way_is_left_as_it_is(bench: Bench) -> None:
    an_edge(bench)
    dispatched(a_started_run(bench))
    tamper("UPDATE resources_resource SET name = 'Other' WHERE key = 'water'")
    with pytest.raises(CommandError, match=r"rebuild\.under_way"):
        call_command("rebuild", stdout=StringIO(), stderr=StringIO())
    assert bench.node("water").name == "Other"


def test_a_broken_chain_rebuilds_nothing(bench: Bench) -> None:
    done(bench)
    tamper("UPDATE crutd_event SET body = jsonb_set(body, '{code}', '\"x\"') WHERE seq = 2")
    before = state(bench)
    with pytest.raises(CommandError, match=r"rebuild\.chain"):
        call_command("rebuild", stdout=StringIO(), stderr=StringIO())
    assert state(bench) == before


def test_a_row_of_which_no_event_tells_is_not_passed_over(bench: Bench) -> None:
    water = bench.node("water")
    Resource.objects.create(
        lab=bench.lab, parent=water.parent, key="ghost", name="Ghost", kind="vial",
        nature="resource", position=99, config={}, data={}, extra={},
    )  # fmt: skip
    with pytest.raises(CommandError, match=r"rebuild\.stray"):
        call_command("rebuild", stdout=StringIO(), stderr=StringIO())
    assert bench.node("ghost").name == "Ghost"
