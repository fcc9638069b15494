"""What comes to stand where there is no room, by every way in which the record changes."""

from __future__ import annotations

from typing import Any
from uuid import uuid4

import pytest

from labweb.common.clock import new_id
from labweb.crutd import services
from labweb.domain.crutd import operations
from labweb.domain.errors import PreconditionError
from labweb.domain.resources.placement import PLACES
from labweb.domain.resources.resource import Resource as ResourceData
from labweb.domain.resources.resource_kinds import KINDS
from labweb.resources.models import Resource
from tests.builders import Bench
from tests.labweb.crutd.hand import done, node, refused


def created(
    bench: Bench, key: str, kind: str, on: str = "bench_1", **config: object
) -> dict[str, Any]:
    return {
        "op": "create",
        "resource_id": str(uuid4()),
        "parent_id": node(bench, on),
        "key": key,
        "name": key.replace("_", " ").title(),
        "kind": kind,
        "config": config,
    }


def moved(bench: Bench, key: str, to: str) -> dict[str, Any]:
    ends = {"from_id": str(bench.node(key).parent_id), "to_id": node(bench, to)}
    return {"op": "transfer_resource", "resource_id": node(bench, key), **ends}


def archived(bench: Bench, key: str) -> dict[str, Any]:
    return {"op": "delete", "resource_id": node(bench, key), "archive_id": node(bench, "archive")}


def test_a_slot_takes_one_plate_and_the_second_is_refused_by_each_way(bench: Bench) -> None:
    done(bench, created(bench, "slot_1", "slot"))
    for key in ("plate_a", "plate_b", "plate_c"):
        done(bench, created(bench, key, "plate"))
    done(bench, moved(bench, "plate_a", "slot_1"))
    told = refused(bench, moved(bench, "plate_b", "slot_1"), "place.occupied")
    assert "Plate B cannot stand in Slot 1" in told["message"]
    assert "Plate A stands there" in told["message"]
    refused(bench, created(bench, "plate_d", "plate", "slot_1"), "place.occupied")
    done(bench, archived(bench, "plate_c"))
    back = {"op": "restore", "resource_id": node(bench, "plate_c")}
    back |= {"from_id": node(bench, "archive"), "to_id": node(bench, "slot_1")}
    refused(bench, back, "place.occupied")
    done(bench, moved(bench, "plate_a", "bench_1"))
    done(bench, back)


def test_a_plate_on_a_plate_and_a_vial_beside_the_flask_on_a_pan_are_refused(bench: Bench) -> None:
    for key in ("plate_a", "plate_b"):
        done(bench, created(bench, key, "plate"))
    refused(bench, moved(bench, "plate_b", "plate_a"), "place.wrong_kind")
    told = refused(bench, created(bench, "vial", "vial", "balance_1"), "place.occupied")
    assert bench.node("flask_1").name in told["message"]


@pytest.mark.parametrize(
    "kind", sorted(name for name, room in PLACES.items() if room.at_most is not None)
)
def test_no_bounded_place_takes_one_more_than_it_has_room_for(bench: Bench, kind: str) -> None:
    """The rule's own bound, asked of the database by requests over every such kind."""
    room = PLACES[kind]
    thing = "tip" if room.takes == {"tip"} else min(room.takes - {"waste"})
    on = "lab" if kind != "tip_spot" else "rack"
    if kind == "tip_spot":
        done(bench, created(bench, "rack", "tip_rack"))
    done(bench, created(bench, "place", kind, on))
    for number in range(room.at_most or 0):
        done(bench, created(bench, f"t{number}", thing, "place"))
    refused(bench, created(bench, "last", thing, "place"), "place.occupied")


@pytest.mark.parametrize("kind", sorted(kind.name for kind in KINDS.values() if not kind.is_place))
def test_nothing_stands_in_what_is_no_place(bench: Bench, kind: str) -> None:
    inside = {"well": "plate", "tip_spot": "tip_rack"}.get(kind)
    if inside:
        done(bench, created(bench, "labware", inside))
    done(bench, created(bench, "no_place", kind, "labware" if inside else "lab"))
    refused(bench, created(bench, "vial", "vial", "no_place"), "crutd.no_place")


def test_a_rack_that_states_its_sites_takes_no_more(bench: Bench) -> None:
    done(bench, created(bench, "rack", "tube_rack", sites_count=2))
    for number in (1, 2):
        done(bench, created(bench, f"tube_{number}", "tube", "rack"))
    refused(bench, created(bench, "tube_3", "tube", "rack"), "place.occupied")


def test_labware_that_comes_from_a_file_comes_to_no_slot_that_is_taken(bench: Bench) -> None:
    done(bench, created(bench, "slot_1", "slot"))
    done(bench, created(bench, "plate_a", "plate", "slot_1"))
    plate = ResourceData(
        id=new_id(), key="p", name="P", kind="plate", nature=KINDS["plate"].nature,
        parent_id=bench.node("slot_1").id,
    )  # fmt: skip
    before = Resource.objects.count()
    with pytest.raises(PreconditionError) as refusal:
        services.import_labware([plate], lab=bench.lab, actor=bench.people["admin"], source={})
    assert refusal.value.code == "place.occupied"
    assert Resource.objects.count() == before


def test_two_who_bring_something_to_one_slot_do_not_both_succeed(bench: Bench) -> None:
    """What is asked while another has its place locked is refused, and looked at anew after."""
    done(bench, created(bench, "slot_1", "slot"))
    done(bench, created(bench, "plate_a", "plate"))
    operation = operations.from_json(moved(bench, "plate_a", "slot_1"))
    services.lock_operation(operation, lab=bench.lab, targets=[], actor_id=None)
    create = operations.from_json(created(bench, "plate_b", "plate", "slot_1"))
    with pytest.raises(Exception, match="in use"):
        services.carry_out(create, lab=bench.lab, actor_id=bench.people["chemist"].pk)
