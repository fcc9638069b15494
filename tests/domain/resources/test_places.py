"""What may stand where, over every kind of place."""

from __future__ import annotations

from uuid import UUID

import pytest

from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.graph.device_parts import injected
from labweb.domain.graph.device_parts_by_role import SORTS
from labweb.domain.resources.placement import (
    PLACES,
    Place,
    PlacedThing,
    check_arriving,
    check_standing,
)
from labweb.domain.resources.resource_kinds import KINDS, Nature

MANY = 50

ROOM = {
    **dict.fromkeys(("lab", "site", "room", "bench", "workstation", "foreign", "archive"), MANY),
    **dict.fromkeys(("carrier", "storage", "tube_rack", "agv"), MANY),
    **dict.fromkeys(("furnace", "chromatography", "analyser", "battery_tester"), MANY),
    **dict.fromkeys(("slot", "balance", "gripper", "arm", "gantry"), 1),
    **dict.fromkeys(("heater_stirrer", "heater", "stirrer", "thermostat"), 1),
    **dict.fromkeys(("shaker", "plate_reader", "spectrometer", "phase_separator"), 1),
    **dict.fromkeys(("rotary_evaporator", "powder_dispenser"), 2),
    **dict.fromkeys(("deck", "liquid_handler", "injection_valve", "pipette_channel"), 0),
    **dict.fromkeys(("plate", "tip_rack", "tip_spot", "reservoir"), 0),
}
"""How many vials stand in each kind of place at a time."""

OTHERS = {
    ("pipette_channel", "tip"): 1,
    ("tip_spot", "tip"): 1,
    ("plate", "lid"): 1,
    ("tip_rack", "lid"): 1,
    ("reservoir", "lid"): 1,
    ("injection_valve", "sample_loop"): 2,
    ("carrier", "plate"): 1,
    ("slot", "plate"): 1,
    ("slot", "heater_stirrer"): 1,
    ("balance", "plate"): 1,
    ("storage", "plate"): MANY,
    ("deck", "carrier"): MANY,
    ("deck", "slot"): MANY,
    ("liquid_handler", "deck"): MANY,
    ("plate", "well"): MANY,
    ("tip_rack", "tip_spot"): MANY,
    ("reservoir", "trough"): MANY,
    ("lab", "archive"): MANY,
    ("analyser", "carrier"): MANY,
}
"""The same of other things, where a place is made for these."""


def things(kind: str, count: int = 1, *, first: int = 1) -> list[PlacedThing]:
    return [PlacedThing(UUID(int=n), f"{kind} {n}", kind) for n in range(first, first + count)]


def filled(place_kind: str, kind: str) -> int:
    """Put things of a kind into a place until one is refused; return how many stand there."""
    place = PlacedThing(UUID(int=0), "Place", place_kind)
    there: list[PlacedThing] = []
    for thing in things(kind, MANY):
        if check_standing(thing, place, there):
            break
        there.append(thing)
    return len(there)


def test_every_kind_is_in_the_table_and_takes_something_exactly_when_it_is_a_place() -> None:
    assert set(PLACES) == set(KINDS)
    assert {kind for kind, room in PLACES.items() if room.takes} == {
        kind.name for kind in KINDS.values() if kind.is_place
    }
    assert set(ROOM) == {kind.name for kind in KINDS.values() if kind.is_place}


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_place_takes_as_many_vials_as_it_has_room_for(kind: str) -> None:
    assert filled(kind, "vial") == ROOM.get(kind, 0)


@pytest.mark.parametrize(("kind", "thing"), OTHERS)
def test_each_kind_of_place_takes_as_many_as_it_has_room_for(kind: str, thing: str) -> None:
    assert filled(kind, thing) == OTHERS[kind, thing]


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_refused_is_told_with_what_stands_there_and_what_to_do(kind: str) -> None:
    place = PlacedThing(UUID(int=0), "Place", kind)
    there = things("vial", ROOM.get(kind, 0)) if ROOM.get(kind, 0) < MANY else []
    for finding in check_standing(PlacedThing(UUID(int=99), "Newcomer", "vial"), place, there):
        assert "Newcomer" in finding.message
        assert "Place" in finding.message
        assert finding.code in {"place.occupied", "place.wrong_kind", "crutd.no_place"}
        if finding.code == "place.occupied":
            assert finding.context["there"] == [one.name for one in there]
            assert "away first, or choose another place" in finding.message


@pytest.mark.parametrize("kind", ["well", "tip_spot"])
@pytest.mark.parametrize("place", ["bench", "slot", "deck", "carrier", "lab"])
def test_a_part_of_labware_stands_nowhere_else(kind: str, place: str) -> None:
    assert filled(place, kind) == 0


def test_a_plate_does_not_stand_on_a_plate_nor_beside_one_in_a_slot_or_on_a_pan() -> None:
    one, other = things("plate", 2)
    assert [f.code for f in check_standing(other, one, [])] == ["place.wrong_kind"]
    for kind in ("slot", "balance"):
        place = PlacedThing(UUID(int=9), "Place", kind)
        assert check_standing(one, place, []) == []
        (finding,) = check_standing(other, place, [one])
        assert finding.code == "place.occupied"
        assert "plate 1 stands there" in finding.message


def test_a_rack_takes_no_more_tubes_than_it_has_sites() -> None:
    rack = PlacedThing(UUID(int=9), "Rack", "tube_rack")
    tubes = things("tube", 24)
    assert check_standing(tubes[-1], rack, tubes[:23], sites=24) == []
    (finding,) = check_standing(things("vial", first=50)[0], rack, tubes, sites=24)
    assert "24 things, one on each of its sites" in finding.message


@pytest.mark.parametrize("kind", sorted(kind for kind, room in PLACES.items() if room.is_divided))
def test_where_a_place_has_slots_things_stand_in_these(kind: str) -> None:
    place = PlacedThing(UUID(int=9), "Place", kind)
    (finding,) = check_standing(things("vial")[0], place, things("slot", first=5))
    assert finding.code == "place.not_in_slot"


def test_on_a_carrier_stands_one_piece_of_labware_or_vials_and_never_both() -> None:
    place = PlacedThing(UUID(int=9), "Block", "carrier")
    vials, (plate,) = things("vial", 3), things("plate", first=7)
    assert check_standing(vials[2], place, vials[:2]) == []
    assert [f.code for f in check_standing(plate, place, vials)] == ["place.occupied"]
    assert [f.code for f in check_standing(vials[0], place, [plate])] == ["place.occupied"]


@pytest.mark.parametrize("role", SORTS)
def test_what_a_device_brings_has_room_where_it_comes(role: str) -> None:
    spec = DriverSpec(class_name="D", module="m", digest="", roles=(role,))
    config = {"deck": {"1": {}, "2": {}}, "slots_count": 3, "loop_ul": 20.0, "vessel_ul": 1e5}
    made = injected(spec, config, key="d", name="D")
    ids = {part.key: UUID(int=number) for number, part in enumerate(made.parts, start=1)}
    arriving = [
        (
            PlacedThing(ids[part.key], part.name, part.kind),
            ids[part.inside] if part.inside else UUID(int=0),
        )
        for part in made.parts
    ]
    bench = Place(thing=PlacedThing(UUID(int=0), "Bench", "bench"))
    assert check_arriving(arriving, [bench]) == []


def test_two_parts_of_one_device_do_not_come_into_one_slot() -> None:
    slot = PlacedThing(UUID(int=0), "Slot", "slot")
    parts = [(PlacedThing(UUID(int=n), f"Part {n}", "syringe_pump"), slot.id) for n in (1, 2)]
    assert [f.code for f in check_arriving(parts, [Place(thing=slot)])] == ["place.occupied"]


def test_a_device_is_on_a_deck_or_in_a_slot_and_never_in_a_vessel() -> None:
    for kind in (kind.name for kind in KINDS.values() if kind.nature is not Nature.RESOURCE):
        assert filled("slot", kind) == 1
        assert filled("flask", kind) == 0
