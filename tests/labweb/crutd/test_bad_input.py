"""Amounts, trees and ids that no laboratory has: refused whole, and nothing half written."""

from __future__ import annotations

import json
import threading
import time
from typing import Any
from uuid import UUID, uuid4

import pytest
from django.db import connection, connections
from django.db.transaction import atomic

from labweb.crutd import services
from labweb.crutd.models import EventHead
from labweb.domain.crutd import operations
from labweb.domain.errors import LabError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.resources.models import Lab, Resource
from tests.builders import STARTER, Bench, a_lab
from tests.labweb.crutd.hand import delivery, done, material, node, post, pour, refused, rows
from tests.labweb.web import call, read, signed_in


@pytest.mark.parametrize(
    "amount",
    [10**15, 2**63, -(2**63), 2**64, 10**40, 1e300, 0.5, "5", None, True, [1], {"nl": 1}],
)
@pytest.mark.parametrize("op", ["transfer_liquid", "receive"])
def test_an_amount_that_overflows_or_is_none_is_refused(
    bench: Bench,
    op: str,
    amount: Any,  # noqa: ANN401
) -> None:
    operation = pour(bench, "water", "flask_1", 1) | {"amount_nl": amount}
    if op == "receive":
        portions = [{"resource_id": node(bench, "flask_1"), "amount_nl": amount}]
        operation = delivery(bench, portions=portions)
    before = rows()
    status, told = post(bench, operation)
    assert status in (412, 422), told
    assert rows() == before


@pytest.mark.parametrize(
    ("operation", "path"),
    [
        ({"pose": {"x_mm": 1}}, "operation.pose"),
        ({"extra": {}}, "operation.extra"),
        ({"configg": {"capacity_ul": 5}}, "operation.configg"),
        ({"data": {"a": 1}}, "operation.data"),
    ],
)
def test_a_field_of_a_create_that_nobody_reads_is_refused_by_its_path(
    bench: Bench, operation: dict[str, Any], path: str
) -> None:
    plain = {"op": "create", "resource_id": str(uuid4()), "parent_id": node(bench, "bench_1")}
    before = rows()
    status, told = post(bench, plain | {"key": "v", "name": "V", "kind": "vial"} | operation)
    assert (status, told["code"]) == (422, "http.body"), told
    assert [(one["code"], one["subject"]) for one in told["findings"]] == [
        ("http.unknown_field", path)
    ]
    assert rows() == before


def test_a_field_of_a_portion_that_nobody_reads_is_refused_by_its_path(bench: Bench) -> None:
    portions = [{"resource_id": node(bench, "flask_1"), "amount_nl": 5, "amount_ml": 5}]
    status, told = post(bench, delivery(bench, portions=portions))
    assert status == 422
    assert told["findings"][0]["subject"] == "operation.portions[0].amount_ml"


def test_a_field_of_a_config_that_its_kind_does_not_have_is_refused(bench: Bench) -> None:
    operation: dict[str, Any] = {"op": "create", "resource_id": str(uuid4())}
    operation["parent_id"] = node(bench, "bench_1")
    operation |= {"key": "v", "name": "V", "kind": "vial", "config": {"colour": "red"}}
    refused(bench, operation, "lab_file.unknown_field")


@pytest.mark.parametrize("digits", [316, 5000])
def test_an_amount_of_hundreds_of_digits_is_refused_and_is_no_failure(
    bench: Bench, digits: int
) -> None:
    plain = json.dumps({"operation": pour(bench, "water", "flask_1", 12345)})
    body = plain.replace("12345", "9" * digits)
    client = signed_in(bench.people["chemist"])
    answer = client.post("/api/v1/operations", body, content_type="application/json")
    assert answer.status_code == 400, answer.content


@pytest.mark.parametrize("number", ["1e308", "9" * 250])
def test_a_capacity_beyond_all_vessels_is_refused_and_is_no_failure(
    bench: Bench, number: str
) -> None:
    operation: dict[str, Any] = {"op": "create", "resource_id": str(uuid4())}
    operation["parent_id"] = node(bench, "bench_1")
    operation |= {"key": "v", "name": "V", "kind": "vial", "config": {"capacity_ul": 12345}}
    body = json.dumps({"operation": operation}).replace("12345", number)
    client = signed_in(bench.people["chemist"])
    answer = client.post("/api/v1/operations", body, content_type="application/json")
    assert answer.status_code in (412, 422), answer.content


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e400"])
def test_an_amount_that_is_no_number_is_refused(bench: Bench, number: str) -> None:
    plain = json.dumps({"operation": pour(bench, "water", "flask_1", 12345)})
    before = rows()
    answer = signed_in(bench.people["chemist"]).post(
        "/api/v1/operations", plain.replace("12345", number), content_type="application/json"
    )
    assert answer.status_code in (400, 422), answer.content
    assert rows() == before


def test_amounts_that_overflow_together_are_refused(bench: Bench) -> None:
    """Each is below the bound; their sum fits no vessel."""
    most = 999_999_999_999_999
    portions = [{"resource_id": node(bench, key), "amount_nl": most} for key in ("flask_1",) * 2]
    status, told = post(bench, delivery(bench, portions=portions), at="/check")
    assert status == 200
    assert {one["code"] for one in told["findings"]} >= {"crutd.same_vessel"}
    assert "crutd.capacity_exceeded" in {one["code"] for one in told["findings"]}


@pytest.mark.parametrize(("deep", "code"), [(101, "tree.too_deep"), (100_000, "lab_file.too_many")])
@pytest.mark.django_db
def test_a_tree_a_hundred_thousand_deep_is_refused(deep: int, code: str) -> None:
    plain = json.loads((STARTER / "lab.json").read_bytes())
    below = plain["resources"][0]["key"]
    for number in range(deep):
        key = f"deep_{number}"
        plain["resources"].append(
            {
                "key": key, "name": key, "kind": "bench", "parent": below, "pose": None,
                "size_mm": None, "config": {},
            }
        )  # fmt: skip
        below = key
    with pytest.raises(LabError) as refusal:
        services.import_lab(read_lab(json.dumps(plain).encode()), actor=None, source={})
    assert code in {finding.code for finding in refusal.value.findings}
    assert not Lab.objects.exists()


def test_an_id_of_another_thing_makes_no_second_one(bench: Bench) -> None:
    """A lot with the id of a lot, and a resource with the id of a resource."""
    material(bench)
    first = delivery(bench)
    done(bench, first)
    refused(bench, delivery(bench, lot_id=first["lot_id"]), "crutd.lot_received_twice")
    taken = {
        "op": "create", "resource_id": node(bench, "water"), "parent_id": node(bench, "bench_1"),
        "key": "second", "name": "Second", "kind": "vial",
    }  # fmt: skip
    refused(bench, taken, "crutd.taken")


def test_a_lab_whose_resources_share_a_key_and_so_an_id_is_not_imported() -> None:
    plain = json.loads((STARTER / "lab.json").read_bytes())
    plain["resources"][4]["key"] = plain["resources"][3]["key"]
    with pytest.raises(LabError) as refusal:
        read_lab(json.dumps(plain).encode())
    assert refusal.value.code.startswith("lab_file.")


@pytest.mark.django_db(transaction=True)
def test_two_moves_at_the_same_time_make_no_ring() -> None:
    """A into B and B into A, each alone right: one of them is refused, and the tree is a tree."""
    lab = a_lab()
    home, person = lab.node("bench_1"), lab.people["chemist"].pk
    racks = [UUID(int=number, version=4) for number in (1, 2)]
    for rack in racks:
        create = operations.Create(
            resource_id=rack, parent_id=home.id, key=f"r{rack.int % 97}", name="Rack", kind="deck"
        )
        services.carry_out(create, lab=lab.lab, actor_id=person)
    for _ in range(5):
        _race(lab, racks, home.id)
        parents = dict(Resource.objects.filter(pk__in=racks).values_list("pk", "parent_id"))
        assert home.id in parents.values(), "the two stand in each other"
        for rack, parent in parents.items():
            if parent != home.id:
                back = operations.TransferResource(resource_id=rack, from_id=parent, to_id=home.id)
                services.carry_out(back, lab=lab.lab, actor_id=person)


def _race(lab: Bench, racks: list[UUID], home: UUID) -> None:
    start = threading.Barrier(2)
    strange: list[BaseException] = []

    def move(one: UUID, into: UUID) -> None:
        operation = operations.TransferResource(resource_id=one, from_id=home, to_id=into)
        start.wait()
        try:
            services.carry_out(operation, lab=lab.lab, actor_id=lab.people["chemist"].pk)
        except LabError:
            pass
        except BaseException as error:  # noqa: BLE001 - told to the test's own thread
            strange.append(error)
        finally:
            connections.close_all()

    threads = [threading.Thread(target=move, args=ends) for ends in (racks, list(reversed(racks)))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert strange == []


def test_a_body_nested_a_hundred_thousand_deep_is_refused(bench: Bench) -> None:
    before = rows()
    raw = '{"operation": ' + "[" * 100_000 + "]" * 100_000 + "}"
    answer = signed_in(bench.people["chemist"]).post(
        "/api/v1/operations", raw, content_type="application/json"
    )
    assert answer.status_code in (400, 413, 422), answer.content[:300]
    assert rows() == before
    assert call(signed_in(bench.people["chemist"]), "GET", "/api/v1/resources").status_code == 200


@pytest.mark.parametrize("said", ["much", True, None, [1], {"ul": 1}])
def test_a_config_that_states_no_number_states_no_capacity(
    bench: Bench,
    said: Any,  # noqa: ANN401
) -> None:
    """A thing of no known kind may say anything; the lab is shown all the same."""
    config = dict.fromkeys(("capacity_ul", "capacity_mg", "dead_volume_ul"), said)
    create = {"op": "create", "resource_id": str(uuid4()), "parent_id": node(bench, "bench_1")}
    done(bench, create | {"key": "odd", "name": "Odd", "kind": "foreign", "config": config})
    told = read(signed_in(bench.people["chemist"]), "/api/v1/resources")["resources"]
    assert [row["capacity_nl"] for row in told if row["key"] == "odd"] == [None]
    refused(bench, pour(bench, "water", "odd", 1000), "crutd.unknown_capacity")


@pytest.mark.django_db(transaction=True)
def test_a_lot_that_two_people_receive_at_the_same_time_comes_once() -> None:
    """Of one number, into two vessels: both ask before either has written."""
    lab = a_lab()
    material(lab)
    told = [delivery(lab, to=key, number="N-1") for key in ("flask_1", "flask_2")]
    ends: list[str] = []

    def receive(plain: dict[str, Any]) -> None:
        try:
            operation = operations.from_json(plain)
            services.carry_out(operation, lab=lab.lab, actor_id=lab.people["chemist"].pk)
            ends.append("received")
        except LabError as error:
            ends.append(error.code)
        finally:
            connections.close_all()

    threads = [threading.Thread(target=receive, args=(one,)) for one in told]
    with atomic():
        EventHead.objects.select_for_update().get(lab=lab.lab)
        for thread in threads:
            thread.start()
        _wait_until_both_wait()
    for thread in threads:
        thread.join()
    assert sorted(ends) == ["crutd.lot_received_twice", "received"]


def _wait_until_both_wait() -> None:
    sql = (
        "SELECT count(*) FROM pg_stat_activity "
        "WHERE datname = current_database() AND wait_event_type = 'Lock'"
    )
    until = time.monotonic() + 30
    with connection.cursor() as cursor:
        while time.monotonic() < until:
            cursor.execute("SELECT pg_stat_clear_snapshot()")
            cursor.execute(sql)
            if cursor.fetchone()[0] >= 2:
                return
            time.sleep(0.05)
    raise AssertionError("the two do not wait")


@pytest.mark.parametrize("at", ["0001-01-01T00:00:00%2B23:59", "1900-01-01T00:00:00%2B23:00"])
def test_a_time_that_the_database_cannot_read_is_refused(bench: Bench, at: str) -> None:
    told = read(signed_in(bench.people["chemist"]), f"/api/v1/resources?at={at}", 422)
    assert told["code"] in ("http.query", "time.before_lab")
