"""The record: chained, appended, and written in one place."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from uuid import uuid4

import pytest
from django.db import DatabaseError, connection
from django.db.models import Model
from django.db.transaction import atomic
from django.test.utils import CaptureQueriesContext

from labweb.accounts.models import AuditEntry
from labweb.approvals.models import ApprovalRequest, Decision
from labweb.crutd import services
from labweb.crutd.models import Entry, Event, EventSubject
from labweb.crutd.services import event_hash
from labweb.domain.crutd import operations
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.errors import LockedError, PreconditionError, StateError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.runs import services as run_services
from labweb.workflows.models import WorkflowVersion
from tests.builders import HEAT, STARTER, Bench, a_started_run, an_edge

ROOT = Path(__file__).parents[3]
WRITES = {
    "create", "bulk_create", "update", "bulk_update", "get_or_create", "update_or_create", "delete",
}  # fmt: skip


def move_to(bench: Bench, key: str, place: str) -> operations.TransferResource:
    row = bench.unplug(key)
    assert row.parent_id is not None
    return operations.TransferResource(
        resource_id=row.id, from_id=row.parent_id, to_id=bench.node(place).id
    )


def test_every_event_binds_the_one_before(bench: Bench) -> None:
    run = a_started_run(bench)
    an_edge(bench).work_off(run)
    events = list(Event.objects.order_by("seq"))
    assert [event.seq for event in events] == list(range(1, len(events) + 1))
    assert len(events) > 5
    for before, event in pairwise(events):
        assert event.prev_hash == before.hash
    for event in events:
        at, about = event.at.isoformat(), str(event.transaction_id)
        assert event.hash == event_hash(event.prev_hash, event.seq, at, about, event.body)


def test_a_changed_event_no_longer_fits_its_hash(bench: Bench) -> None:
    event = Event.objects.get()
    body = {**event.body, "message": "nothing was received"}
    at = event.at.isoformat()
    assert event.hash != event_hash(event.prev_hash, event.seq, at, str(event.transaction_id), body)


APPENDED = (Event, EventSubject, Entry, AuditEntry, WorkflowVersion)


@pytest.mark.parametrize("model", APPENDED)
@pytest.mark.parametrize("change", ["UPDATE {} SET id = id", "DELETE FROM {}"])
def test_the_database_refuses_to_change_or_erase_what_was_appended(
    bench: Bench, model: type[Model], change: str
) -> None:
    before = model._default_manager.count()
    assert before
    with pytest.raises(DatabaseError, match="append-only"), atomic():
        connection.cursor().execute(change.format(model._meta.db_table))
    assert model._default_manager.count() == before


def test_a_decision_is_never_edited(bench: Bench) -> None:
    a_started_run(bench, HEAT)
    request = ApprovalRequest.objects.get()
    run_services.decide_request(
        request.id, actor=bench.people["approver"], is_approved=True, comment="seen"
    )
    with pytest.raises(DatabaseError, match="append-only"), atomic():
        Decision.objects.update(comment="not seen")


def test_a_lab_is_imported_once(bench: Bench) -> None:
    with pytest.raises(StateError) as refusal:
        services.import_lab(bench.file, actor=None, source={})
    assert refusal.value.code == "lab.exists"


def test_an_import_receives_its_contents_and_balances(bench: Bench) -> None:
    lab = read_lab((STARTER / "lab.json").read_bytes())
    total = sum(sum(held.values()) for held in lab.contents.values())
    posted = Entry.objects.filter(state="posted", debit="RECEIPT")
    assert sum(posted.values_list("amount_nl", flat=True)) == total


def test_a_persons_move_changes_one_row_and_leaves_an_event(bench: Bench) -> None:
    operation = move_to(bench, "flask_2", "lab")
    flask = bench.node("flask_2")
    services.carry_out(operation, lab=bench.lab, actor_id=bench.people["chemist"].pk)
    moved = bench.node("flask_2")
    assert moved.parent_id == operation.to_id
    assert (moved.pose, moved.rev) == (None, flask.rev + 1)
    assert Event.objects.order_by("-seq")[0].body["change"]["moves"] == {
        str(flask.id): str(operation.to_id)
    }


def test_what_is_locked_cannot_be_moved(bench: Bench) -> None:
    operation = move_to(bench, "flask_2", "lab")
    services.lock_operation(operation, lab=bench.lab, targets=[], actor_id=None)
    with pytest.raises(LockedError) as refusal:
        services.carry_out(operation, lab=bench.lab, actor_id=bench.people["chemist"].pk)
    assert refusal.value.code == "crutd.locked"


def test_a_lock_above_is_told_by_what_it_concerns(bench: Bench) -> None:
    """Whoever asks may not know of all that stands above."""
    whole = operations.Read(device_id=bench.node("bench_1").id)
    services.lock_operation(whole, lab=bench.lab, targets=[], actor_id=None)
    with pytest.raises(LockedError) as refusal:
        services.lock_operation(
            operations.Read(device_id=bench.node("ph_1").id),
            lab=bench.lab, targets=[], actor_id=None,
        )  # fmt: skip
    name = bench.node("ph_1").name
    assert refusal.value.message == f"what {name} stands in is in use: its read has not ended yet"


def queries_of_a_transfer(bench: Bench) -> tuple[int, int]:
    """Return how many statements a transfer by a device costs, and one by hand."""
    operation = operations.TransferLiquid(
        source_id=bench.node("water").id, target_id=bench.node("flask_1").id, amount_nl=1_000
    )
    with CaptureQueriesContext(connection) as by_a_device:
        row = services.lock_operation(operation, lab=bench.lab, targets=[], actor_id=None)
        done = Outcome(kind=OutcomeKind.DONE)
        services.settle(row.id, services.Settlement(outcome=done))
    with CaptureQueriesContext(connection) as by_hand:
        actor_id = bench.people["chemist"].pk
        services.carry_out(operation, lab=bench.lab, actor_id=actor_id)
    counts = [
        sum("SAVEPOINT" not in query["sql"] for query in queries.captured_queries)
        for queries in (by_a_device, by_hand)
    ]
    return counts[0], counts[1]


def test_a_transfer_costs_the_same_queries_whatever_the_size_of_the_tree(bench: Bench) -> None:
    assert queries_of_a_transfer(bench) == (13, 10)
    for number in range(50):
        create = operations.Create(
            resource_id=uuid4(),
            parent_id=bench.node("bench_1").id,
            key=f"vial {number}",
            name="Vial",
            kind="vial",
        )
        services.carry_out(create, lab=bench.lab, actor_id=bench.people["chemist"].pk)
    assert queries_of_a_transfer(bench) == (13, 10)


def test_a_lock_on_a_place_closes_what_stands_in_it(bench: Bench) -> None:
    actor = bench.people["chemist"].pk
    bench_1, lab = bench.node("bench_1"), bench.lab
    update = operations.Update(resource_id=bench_1.id, data={"note": "closed"})
    services.lock_operation(update, lab=lab, targets=[], actor_id=None)
    with pytest.raises(LockedError):
        services.carry_out(move_to(bench, "flask_2", "lab"), lab=lab, actor_id=actor)


def test_nothing_can_be_carried_into_itself(bench: Bench) -> None:
    root, bench_1 = bench.node("lab"), bench.node("bench_1")
    operation = operations.TransferResource(
        resource_id=bench_1.id, from_id=root.id, to_id=bench_1.id
    )
    with pytest.raises(PreconditionError) as refusal:
        services.carry_out(operation, lab=bench.lab, actor_id=bench.people["chemist"].pk)
    assert refusal.value.code == "crutd.into_itself"


def is_resource_write(call: ast.Call) -> bool:
    """Tell whether a call writes Resource rows: through its manager, or by saving one."""
    chain: list[str] = []
    node: ast.expr = call.func
    while isinstance(node, ast.Attribute | ast.Call):
        if isinstance(node, ast.Attribute):
            chain.append(node.attr)
            node = node.value
        else:
            node = node.func
    return isinstance(node, ast.Name) and node.id == "Resource" and bool(WRITES & {*chain})


def writers(source: str) -> Iterator[int]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and is_resource_write(node):
            yield node.lineno


def test_resource_rows_are_written_in_one_place() -> None:
    allowed = {ROOT / "labweb/resources/services.py"}
    found = []
    for path in sorted((ROOT / "labweb").rglob("*.py")):
        text = path.read_text("utf-8")
        if path in allowed or "migrations" in path.parts:
            continue
        found += [f"{path}:{line}" for line in writers(text)]
        if "resource_services" in text and not path.is_relative_to(ROOT / "labweb/crutd"):
            calls = {
                node.func.attr
                for node in ast.walk(ast.parse(text))
                if isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and isinstance(node.func.value, ast.Name)
                and node.func.value.id == "resource_services"
            }
            # The stop latch is a column of the lab, not of a resource.
            found += [f"{path}: {name}" for name in calls - {"latch_stop", "release_stop"}]
    assert not found, f"resources are written by crutd alone: {found}"


def test_the_search_for_writers_finds_one() -> None:
    assert list(writers("Resource.objects.filter(pk=1).update(name='x')")) == [1]
    assert list(writers("Resource.objects.filter(pk=1).exists()")) == []
