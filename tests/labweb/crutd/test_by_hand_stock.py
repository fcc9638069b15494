"""Taking stock, disposal, the Archive, and requests that are none."""

from __future__ import annotations

from typing import Any
from uuid import UUID, uuid4

import pytest

from labweb.crutd.models import Entry, Event, Holding
from labweb.resources.models import Resource
from labweb.runs import services as run_services
from tests.builders import Bench, a_started_run, a_user, an_edge, to_transfer
from tests.labweb.crutd.hand import (
    done,
    nl,
    node,
    post,
    pour,
    refused,
    rows,
)
from tests.labweb.web import call, signed_in

# --- taking stock ---


def correction(bench: Bench, key: str, **fields: Any) -> dict[str, Any]:  # noqa: ANN401
    plain = {
        "op": "correct",
        "resource_id": node(bench, key),
        "account": "LOSS",
        "reason": "weighed",
    }
    return plain | fields


def lot_of(bench: Bench, key: str) -> str:
    return str(Holding.objects.get(resource=bench.node(key)).lot_id)


@pytest.mark.parametrize("account", ["LOSS", "REACTION", "SUSPENSE", "DEAD_VOLUME"])
@pytest.mark.parametrize("change", [-500, 0, 700])
def test_taking_stock_posts_the_difference(bench: Bench, account: str, change: int) -> None:
    lot, before = lot_of(bench, "water"), nl(bench, "water")
    measured = {lot: before + change}
    told = done(bench, correction(bench, "water", account=account, measured_nl=measured))
    assert nl(bench, "water") == before + change
    entries = Entry.objects.filter(transaction=told["transaction_id"])
    assert [entry.amount_nl for entry in entries] == ([abs(change)] if change else [])
    assert all(account in (entry.debit, entry.credit) for entry in entries)


def test_a_vessel_whose_outcome_was_given_up_is_freed_by_taking_stock(bench: Bench) -> None:
    edge = an_edge(bench)
    run = a_started_run(bench)
    attempt = to_transfer(run, edge)
    edge.lose(attempt)
    key = Resource.objects.get(pk=attempt.job.operation["source_id"]).key
    lot = lot_of(bench, key)
    stock = correction(bench, key, account="SUSPENSE", measured_nl={lot: 4_000_000})
    status, told = post(bench, stock)
    assert (status, told["code"]) == (423, "crutd.locked"), "a doubt is answered first"
    words = "is in use: a person answers first what became of its transfer in doubt"
    assert told["message"].endswith(words)
    run_services.resolve_job(
        attempt.job_id, actor=bench.people["chemist"], answer="discard", moved_nl=None, note="?"
    )
    edge.resolve(attempt)
    rev = bench.node(key).rev
    done(bench, stock)
    assert (bench.node(key).quarantined_by, bench.node(key).rev) == (None, rev + 1)
    assert nl(bench, key) == 4_000_000
    assert Resource.objects.filter(quarantined_by=attempt.transaction_id).count() == 1


def test_a_correction_says_why_and_where_to(bench: Bench) -> None:
    measured = {"measured_nl": {lot_of(bench, "water"): 1}}
    refused(bench, correction(bench, "water", reason=" ", **measured), "crutd.reason_missing")
    refused(bench, correction(bench, "water", account="RECEIPT", **measured), "crutd.bad_account")


def test_a_correction_names_lots_in_their_unit(bench: Bench) -> None:
    lot = lot_of(bench, "water")
    refused(bench, correction(bench, "water", measured_ug={lot: 1}), "crutd.unit_mismatch")
    for unknown in (str(uuid4()), "water"):
        refused(bench, correction(bench, "water", measured_nl={unknown: 1}), "crutd.no_lot")
    full = bench.node("water").config["capacity_ul"] * 1000 + 1
    refused(bench, correction(bench, "water", measured_nl={lot: full}), "crutd.capacity_exceeded")


def test_who_may_run_but_not_resolve_takes_no_stock(bench: Bench) -> None:
    status, told = post(bench, correction(bench, "water"), role="observer")
    assert (status, told["code"]) == (403, "governance.forbidden")


# --- going out ---


def test_what_is_poured_away_goes_to_waste(bench: Bench) -> None:
    before = nl(bench, "water")
    operation = {"op": "dispose", "resource_id": node(bench, "water")}
    told = done(bench, operation | {"amount_nl": 1_000})
    assert Entry.objects.get(transaction=told["transaction_id"]).credit == "WASTE"
    assert nl(bench, "water") == before - 1_000
    refused(bench, operation | {"amount_nl": before}, "crutd.insufficient_volume")
    refused(bench, operation | {"amount_ug": 1}, "crutd.insufficient_mass")
    refused(bench, operation | {"amount_nl": 0}, "crutd.not_positive")
    done(bench, operation)
    refused(bench, operation, "crutd.empty")


def archive(bench: Bench, key: str) -> dict[str, Any]:
    where = {"archive_id": node(bench, "archive")}
    return {"op": "delete", "resource_id": node(bench, key), **where}


def restore(bench: Bench, key: str, to: str) -> dict[str, Any]:
    ends = {"from_id": node(bench, "archive"), "to_id": node(bench, to)}
    return {"op": "restore", "resource_id": node(bench, key), **ends}


def test_what_is_deleted_goes_to_the_archive_and_comes_back(bench: Bench) -> None:
    bench.unplug("flask_1")
    count = Event.objects.filter(subjects__resource=bench.node("flask_1")).count()
    done(bench, archive(bench, "flask_1"))
    flask = bench.node("flask_1")
    assert (flask.is_archived, flask.parent_id) == (True, bench.node("archive").id)
    refused(bench, pour(bench, "water", "flask_1", 100), "crutd.archived")
    done(bench, restore(bench, "flask_1", "bench_1"))
    flask = bench.node("flask_1")
    assert (flask.is_archived, flask.parent_id) == (False, bench.node("bench_1").id)
    assert Event.objects.filter(subjects__resource=flask).count() == count + 2
    done(bench, pour(bench, "water", "flask_1", 100))


def test_what_is_in_service_is_not_restored(bench: Bench) -> None:
    flask = bench.node("flask_1")
    operation = restore(bench, "flask_1", "bench_1") | {"from_id": str(flask.parent_id)}
    refused(bench, operation, "crutd.not_archived")


@pytest.mark.parametrize("op", ["transfer_resource", "restore", "create"])
def test_nothing_in_service_comes_to_stand_in_the_archive(bench: Bench, op: str) -> None:
    """What stands there is out of service; so only a delete takes it there."""
    flask = bench.unplug("flask_1")
    there, old = node(bench, "archive"), str(flask.parent_id)
    operation = {"op": op, "resource_id": str(flask.id), "from_id": old, "to_id": there}
    if op == "restore":
        done(bench, archive(bench, "flask_1"))
        operation["from_id"] = there
    if op == "create":
        operation = {"op": op, "resource_id": str(uuid4()), "parent_id": there}
        operation |= {"key": "new", "name": "New", "kind": "vial"}
    refused(bench, operation, "crutd.into_archive")


def test_a_carry_to_where_a_thing_stands_is_not_written_down(bench: Bench) -> None:
    flask = bench.unplug("flask_1")
    ends = dict.fromkeys(("from_id", "to_id"), str(flask.parent_id))
    operation = {"op": "transfer_resource", "resource_id": str(flask.id), **ends}
    refused(bench, operation, "crutd.there_already")


def test_what_stands_in_something_archived_is_archived_with_it(bench: Bench) -> None:
    rack = UUID(int=5, version=4)
    create = {"op": "create", "resource_id": str(rack), "parent_id": node(bench, "bench_1")}
    done(bench, create | {"key": "rack", "name": "Rack", "kind": "carrier"})
    flask = bench.unplug("flask_1")
    ends = {"from_id": str(flask.parent_id), "to_id": str(rack)}
    done(bench, {"op": "transfer_resource", "resource_id": str(flask.id), **ends})
    done(bench, archive(bench, "rack"))
    assert not bench.node("flask_1").is_archived
    refused(bench, pour(bench, "water", "flask_1", 100), "crutd.archived")


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"kind": "spaceship"}, "crutd.unknown_kind"),
        ({"key": "water"}, "crutd.taken"),
        ({"parent_id": "flask_1"}, "crutd.no_place"),
        ({"config": {"capacity_ul": -1}}, "lab_file.field"),
    ],
)
def test_a_new_resource_has_a_kind_a_place_and_a_key_of_its_own(
    bench: Bench, fields: dict[str, Any], code: str
) -> None:
    plain = {"op": "create", "resource_id": str(uuid4()), "parent_id": "bench_1", "kind": "vial"}
    operation = plain | {"key": "new", "name": "New"} | fields
    operation["parent_id"] = node(bench, operation["parent_id"])
    refused(bench, operation, code)


def test_an_id_that_is_taken_is_not_given_again(bench: Bench) -> None:
    operation = {"op": "create", "parent_id": node(bench, "bench_1"), "key": "new", "name": "New"}
    operation |= {"kind": "vial", "resource_id": node(bench, "flask_1")}
    refused(bench, operation, "crutd.taken")


# --- hostile requests ---


@pytest.mark.parametrize(
    "operation",
    [
        {},
        {"op": "explode"},
        {"op": "update", "resource_id": str(uuid4()), "data": {}},
        {"op": "dispose", "resource_id": "water"},
        {"op": "dispose", "resource_id": str(uuid4()), "amount_nl": -1},
        {"op": "dispose", "resource_id": str(uuid4()), "amount_nl": 2**63},
        {"op": "dispose", "resource_id": str(uuid4()), "amount_nl": 1.5},
        {"op": "correct", "resource_id": str(uuid4()), "account": "POCKET", "reason": "x"},
    ],
)
def test_what_is_no_operation_is_refused_as_a_body(bench: Bench, operation: dict[str, Any]) -> None:
    before = rows()
    status, told = post(bench, operation)
    assert (status, told["code"]) == (422, "http.body"), told
    assert rows() == before


@pytest.mark.parametrize("amount_nl", [0, -1, 2**200])
def test_an_amount_that_is_none_moves_nothing(bench: Bench, amount_nl: int) -> None:
    before = rows()
    status, told = post(bench, pour(bench, "water", "flask_1", amount_nl))
    assert status in (412, 422), told
    assert rows() == before


def test_who_does_not_see_a_vessel_learns_nothing_of_it(bench: Bench) -> None:
    bench.people["guest"] = a_user("chemist", on=bench.node("flask_1"), name="guest")
    operation = pour(bench, "water", "flask_1", 1_000)
    client = signed_in(bench.people["guest"])
    answer = call(client, "POST", "/api/v1/operations", {"operation": operation})
    assert (answer.status_code, answer.json()["code"]) == (404, "resource.not_found")  # type: ignore[attr-defined]
