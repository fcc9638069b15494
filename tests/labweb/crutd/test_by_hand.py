"""What people receive and move by hand: checked, written down whole, or refused whole."""

from __future__ import annotations

from uuid import uuid4

import pytest

from labweb.crutd.models import Entry, Holding
from labweb.resources.models import Lot, Material, Resource
from tests.builders import Bench, a_started_run, an_edge, to_transfer
from tests.labweb.crutd.hand import (
    LATER,
    a_jar,
    delivery,
    done,
    held,
    material,
    nl,
    node,
    post,
    pour,
    refused,
    rows,
    solid,
)

# --- coming in ---


def test_a_delivery_comes_out_of_receipt_into_its_vessels(bench: Bench) -> None:
    portions = [
        {"resource_id": node(bench, "flask_1"), "amount_nl": 3_000_000},
        {"resource_id": node(bench, "flask_2"), "amount_nl": 2_000_000},
    ]
    told = done(bench, delivery(bench, key="L", portions=portions, expires_on=LATER))
    assert (held(bench, "flask_1"), held(bench, "flask_2")) == (
        {"L": (3_000_000, 0)},
        {"L": (2_000_000, 0)},
    )
    entries = Entry.objects.filter(transaction=told["transaction_id"], state="posted")
    assert {entry.debit for entry in entries} == {"RECEIPT"}
    assert told["operation"] == "create"


@pytest.mark.parametrize("same", ["lot_id", "key", "number"])
def test_a_lot_that_is_received_twice_is_refused(bench: Bench, same: str) -> None:
    first = delivery(bench)
    done(bench, first)
    refused(bench, delivery(bench, **{same: first[same]}), "crutd.lot_received_twice")


def test_an_expired_lot_is_not_received(bench: Bench) -> None:
    refused(bench, delivery(bench, expires_on="2020-01-01"), "crutd.expired_lot")


def test_a_delivery_of_no_known_material_is_refused(bench: Bench) -> None:
    refused(bench, delivery(bench, material_id=str(uuid4())), "crutd.no_material")


def test_a_unit_mismatch_is_refused(bench: Bench) -> None:
    a_jar(bench, "jar")
    portions = [{"resource_id": node(bench, "jar"), "amount_nl": 5}]
    refused(bench, delivery(bench, phase="solid", portions=portions), "crutd.unit_mismatch")
    portions = [{"resource_id": node(bench, "jar"), "amount_ug": 5}]
    refused(bench, delivery(bench, phase="liquid", portions=portions), "crutd.unit_mismatch")


def test_a_solid_comes_only_where_its_room_is_stated(bench: Bench) -> None:
    refused(bench, solid(bench, "flask_1", 5), "crutd.unknown_capacity")


def test_a_delivery_that_does_not_fit_is_refused(bench: Bench) -> None:
    capacity = bench.node("flask_1").config["capacity_ul"] * 1000
    portions = [{"resource_id": node(bench, "flask_1"), "amount_nl": capacity + 1}]
    refused(bench, delivery(bench, portions=portions), "crutd.capacity_exceeded")


# --- moving ---


def test_a_person_pours_and_the_ledger_follows(bench: Bench) -> None:
    before = nl(bench, "water")
    told = done(bench, pour(bench, "water", "flask_1", 2_000_000))
    assert (nl(bench, "water"), nl(bench, "flask_1")) == (before - 2_000_000, 2_000_000)
    assert told["verification"] == "assumed"


def test_a_transfer_is_refused_when_the_target_is_full(bench: Bench) -> None:
    capacity = bench.node("flask_1").config["capacity_ul"] * 1000
    portions = [{"resource_id": node(bench, "flask_1"), "amount_nl": capacity}]
    done(bench, delivery(bench, portions=portions))
    told = refused(bench, pour(bench, "water", "flask_1", 1), "crutd.capacity_exceeded")
    assert told["findings"][0]["context"]["free_nl"] == 0


def test_a_transfer_is_refused_when_the_source_is_short_by_its_dead_volume(bench: Bench) -> None:
    water = bench.node("water")
    config = water.config | {"dead_volume_ul": 2_000}
    Resource.objects.filter(pk=water.pk).update(config=config)
    portions = nl(bench, "water") - 2_000_000
    away = {"op": "dispose", "resource_id": str(water.id), "amount_nl": portions - 1_000}
    assert post(bench, away)[0] == 201
    refused(bench, pour(bench, "water", "flask_1", 1_001), "crutd.insufficient_volume")


def test_a_transfer_of_the_wrong_phase_is_refused(bench: Bench) -> None:
    a_jar(bench, "jar")
    done(bench, solid(bench, "jar", 5_000))
    done(bench, pour(bench, "water", "jar", 1_000_000))
    refused(bench, pour(bench, "jar", "flask_2", 1_000), "crutd.wrong_phase")


def test_a_gas_stays_above_the_liquid_that_is_poured(bench: Bench) -> None:
    a_jar(bench, "jar")
    done(bench, solid(bench, "jar", 5_000, key="argon") | {"phase": "gas"})
    done(bench, pour(bench, "water", "jar", 1_000_000))
    done(bench, pour(bench, "jar", "flask_2", 1_000))
    assert held(bench, "jar")["argon"] == (0, 5_000)


def test_a_solid_is_moved_by_mass_and_a_liquid_is_not(bench: Bench) -> None:
    a_jar(bench, "jar")
    a_jar(bench, "other")
    done(bench, solid(bench, "jar", 5_000, key="salt"))
    done(bench, solid(bench, "other", 1_000, key="more"))
    ends = {"source_id": node(bench, "jar"), "target_id": node(bench, "other")}
    move = {"op": "transfer_mass", "amount_ug": 2_000, "phase": "solid", **ends}
    done(bench, move)
    assert held(bench, "jar") == {"salt": (0, 3_000)}
    assert held(bench, "other") == {"salt": (0, 2_000), "more": (0, 1_000)}
    refused(bench, move | {"amount_ug": 3_001}, "crutd.insufficient_mass")
    refused(bench, move | {"phase": "gas"}, "crutd.wrong_phase")
    ends = {"source_id": node(bench, "water"), "target_id": node(bench, "other")}
    status, told = post(bench, move | {"phase": "liquid", **ends}, at="/check")
    assert status == 200
    codes = {finding["code"] for finding in told["findings"]}
    assert codes == {"crutd.unit_mismatch", "crutd.insufficient_mass"}


def test_more_of_a_solid_than_fits_is_refused(bench: Bench) -> None:
    a_jar(bench, "jar")
    a_jar(bench, "other")
    done(bench, solid(bench, "jar", 99_000))
    done(bench, solid(bench, "other", 1_001))
    ends = {"source_id": node(bench, "other"), "target_id": node(bench, "jar")}
    move = {"op": "transfer_mass", "amount_ug": 1_001, "phase": "solid", **ends}
    refused(bench, move, "crutd.capacity_exceeded")


@pytest.mark.parametrize("lists", ["groups", "key", "the other"])
def test_incompatible_materials_never_meet(bench: Bench, lists: str) -> None:
    water = Holding.objects.get(resource=bench.node("water")).lot.material
    if lists == "the other":
        Material.objects.filter(pk=water.pk).update(incompatible_with=["acid"])
        material(bench)
    elif lists == "key":
        material(bench, incompatible_with=[water.key])
    else:
        Material.objects.filter(pk=water.pk).update(groups=["aqueous"])
        material(bench, incompatible_with=["aqueous"])
    done(bench, delivery(bench))
    refused(bench, pour(bench, "water", "flask_1", 1_000), "crutd.incompatible")
    refused(bench, delivery(bench, "water"), "crutd.incompatible")


def test_what_is_listed_nowhere_is_not_guessed(bench: Bench) -> None:
    material(bench, name="Strong acid", hazards=["H314"])
    done(bench, delivery(bench))
    done(bench, pour(bench, "water", "flask_1", 1_000))


def test_an_expired_lot_is_not_used_and_can_be_disposed_of(bench: Bench) -> None:
    done(bench, delivery(bench, key="old"))
    Lot.objects.filter(key="old").update(expires_on="2020-01-01")
    refused(bench, pour(bench, "flask_1", "flask_2", 1_000), "crutd.expired_lot")
    done(bench, {"op": "dispose", "resource_id": node(bench, "flask_1")})
    assert nl(bench, "flask_1") == 0


def test_a_vessel_that_is_held_elsewhere_is_not_used(bench: Bench) -> None:
    attempt = to_transfer(a_started_run(bench), an_edge(bench))
    source = attempt.job.operation["source_id"]
    operation = pour(bench, "flask_1", "flask_2", 1_000) | {"source_id": source}
    status, told = post(bench, operation, at="/check")
    found = {one["code"]: one for one in told["findings"]}
    assert status == 200
    assert found["crutd.held_elsewhere"]["subject"] == source
    assert found["crutd.held_elsewhere"]["context"] == {
        "transaction_id": str(attempt.transaction_id)
    }
    before = rows()
    status, told = post(bench, operation)
    assert (status, told["code"]) == (423, "crutd.locked")
    assert rows() == before


def test_after_a_refused_transfer_a_vial_is_never_in_neither_place(bench: Bench) -> None:
    """A carry that is refused, and one that fails half way, leave the vial where it stood."""
    flask, home = bench.unplug("flask_1"), bench.node("flask_1").parent_id
    to_nowhere = {
        "op": "transfer_resource",
        "resource_id": str(flask.id),
        "from_id": str(home),
        "to_id": node(bench, "flask_2"),
    }
    refused(bench, to_nowhere, "crutd.no_place")
    assert bench.node("flask_1").parent_id == home
    from_elsewhere = to_nowhere | {"from_id": node(bench, "archive"), "to_id": str(home)}
    refused(bench, from_elsewhere, "crutd.not_there")
    assert bench.node("flask_1").parent_id == home
    gone = to_nowhere | {"to_id": str(uuid4())}
    assert post(bench, gone)[0] == 404
    assert bench.node("flask_1").parent_id == home
    done(bench, to_nowhere | {"to_id": node(bench, "bench_1")})
    assert bench.node("flask_1").parent_id == bench.node("bench_1").id
