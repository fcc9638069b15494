"""A device comes into the lab with its parts and the tubes between, or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pytest_django import Settings

from labweb.accounts.models import AuditEntry
from labweb.common.signatures import authority
from labweb.crutd import services
from labweb.crutd.models import Event
from labweb.domain.errors import EnrollmentError, LabError, StateError
from labweb.enrollment import selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.models import Candidate, Device
from labweb.enrollment.services import WantedDevice
from labweb.resources.models import Connection, Resource
from tests.builders import Bench, an_edge, catalog
from tests.labweb.enrollment.test_discovery import seen
from tests.labweb.web import signed_in


@pytest.fixture(autouse=True)
def _own_authority(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


def wanted(bench: Bench, name: str = "Pump 9", **config: Any) -> WantedDevice:  # noqa: ANN401 - settings
    pump = bench.device("pump_1")
    return WantedDevice(
        name=name,
        driver_digest=pump.driver.digest,
        transport="tcp://192.0.2.9:5000",
        config={**pump.config, **config},
    )


def adopted(
    bench: Bench, row: Candidate, wish: WantedDevice | None = None, typed: str = ""
) -> Device:
    return services.adopt_candidate(
        row.id,
        wish or wanted(bench),
        parent_id=bench.node("bench_1").id,
        typed=typed or selectors.code_of_candidate(row),
        reason="label compared",
        actor=bench.people["admin"],
    )


def counted() -> list[int]:
    return [kind.objects.count() for kind in (Device, Resource, Connection, Event)]


def test_a_pump_comes_with_syringe_valve_and_the_tube_between(bench: Bench) -> None:
    device = adopted(bench, seen(bench, an_edge(bench)))
    syringe, valve = bench.node("pump_9"), bench.node("pump_9_valve")
    assert device.nodes == {"pump": str(syringe.id), "valve": str(valve.id)}
    assert (syringe.kind, syringe.config) == ("syringe_pump", {"capacity_ul": 5000})
    assert (valve.kind, valve.config["ports_count"]) == ("rotary_valve", 8)
    assert {syringe.parent_id, valve.parent_id} == {bench.node("bench_1").id}
    tube = Connection.objects.get(source=syringe)
    assert (tube.source_port, tube.target, tube.target_port) == ("outlet", valve, "common")
    event = Event.objects.latest("seq")
    assert [part["key"] for part in event.body["parts"]] == ["pump_9_valve"]
    assert [link["key"] for link in event.body["links"]] == [tube.key]


def test_the_lab_with_it_is_rebuilt_from_its_events(bench: Bench) -> None:
    adopted(bench, seen(bench, an_edge(bench)))
    before = list(Connection.objects.order_by("key").values("id", "key", "medium", "target_port"))
    Resource.objects.filter(key="pump_9_valve").update(name="wrong")
    Connection.objects.filter(key="pump_9_pump_9_valve").delete()
    services.rebuild(bench.lab)
    assert bench.node("pump_9_valve").name == "Pump 9, rotary valve"
    after = list(Connection.objects.order_by("key").values("id", "key", "medium", "target_port"))
    assert after == before


def _taken_key(bench: Bench) -> WantedDevice:
    Resource.objects.filter(key="waste").update(key="pump_9_valve")
    return wanted(bench)


def _no_parts(bench: Bench) -> WantedDevice:
    node = bench.device("timer_1").driver
    node.spec = {**node.spec, "roles": ["node"]}
    node.save()
    return WantedDevice(name="Rover", driver_digest=node.digest, transport="virtual:timer")


def _too_many_ports(bench: Bench) -> WantedDevice:
    driver = bench.device("pump_1").driver
    fields = [
        {**one, "maximum": 200.0} if one["name"] == "ports_count" else one
        for one in driver.spec["config"]
    ]
    driver.spec = {**driver.spec, "config": fields}
    driver.save()
    return wanted(bench, ports_count=100)


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        (_taken_key, "inject.exists"),
        (_no_parts, "inject.nothing"),
        (_too_many_ports, "inject.config"),
    ],
)
def test_when_a_part_is_refused_nothing_is_left(bench: Bench, wrong: Any, code: str) -> None:  # noqa: ANN401 - a builder
    row = seen(bench, an_edge(bench))
    wish, before = wrong(bench), counted()
    with pytest.raises(LabError) as refusal:
        adopted(bench, row, wish)
    assert refusal.value.code == code
    assert counted() == before
    row.refresh_from_db()
    assert (row.state, row.device) == ("new", None)


def test_a_parent_that_is_in_use_leaves_nothing_either(bench: Bench) -> None:
    row, parent = seen(bench, an_edge(bench)), bench.node("bench_1")
    before = counted()
    parent.is_archived = True
    parent.save()
    with pytest.raises(LabError):
        adopted(bench, row)
    assert counted() == before


def test_a_code_that_differs_is_on_record_and_brings_nothing(bench: Bench) -> None:
    row, before = seen(bench, an_edge(bench)), counted()
    with pytest.raises(EnrollmentError):
        adopted(bench, row, typed="0000-0000-0000")
    assert counted() == before
    assert AuditEntry.objects.filter(action="device.code_differs").count() == 1


def test_a_device_that_acts_through_what_is_there_brings_nothing_besides(bench: Bench) -> None:
    row, before = seen(bench, an_edge(bench)), counted()
    both = WantedDevice(
        **{
            **{name: getattr(wanted(bench), name) for name in WantedDevice.__struct_fields__},
            "nodes": {"pump": bench.node("pump_2").id},
        }
    )
    with pytest.raises(StateError) as refusal:
        adopted(bench, row, both)
    assert refusal.value.code == "inject.has_parts"
    assert counted() == before


def test_the_page_brings_the_parts_and_says_so(bench: Bench) -> None:
    row, wish = seen(bench, an_edge(bench)), wanted(bench)
    form = {
        "act": "take_up",
        "code": selectors.code_of_candidate(row),
        "driver": wish.driver_digest,
        "transport": wish.transport,
        "config": '{"syringe_ul": 1000}',
        "name": "Pump 9",
        "place": str(bench.node("bench_1").id),
        "reason": "compared",
    }
    client = signed_in(bench.people["admin"])
    url = f"/admin/enrollment/candidate/{row.id}/review/"
    assert "Its own parts are to stand in" in client.get(url).content.decode()
    answer = client.post(url, form, follow=True)
    assert "with 2 roles in the tree" in answer.content.decode()
    assert bench.node("pump_9").config == {"capacity_ul": 1000}
    enrollment_services.admit_device(
        bench.device("pump_9").id, actor=bench.people["admin"], reason="looked"
    )


def made_of(bench: Bench, module: str, transport: str, **config: object) -> Device:
    driver = enrollment_services.keep_driver(catalog()[module])
    wish = WantedDevice(
        name="New", driver_digest=driver.digest, transport=transport, config=dict(config)
    )
    return adopted(bench, seen(bench, an_edge(bench)), wish)


def tree_of(bench: Bench, device: Device) -> set[tuple[str, str, str]]:
    """Return key and kind of all that came, with the key of that in which it lies."""
    rows = Resource.objects.filter(key__startswith=device.key).select_related("parent")
    return {(row.key, row.kind, row.parent.key if row.parent else "") for row in rows}


def test_a_pipetting_robot_comes_with_its_deck_and_the_slots_of_its_settings(bench: Bench) -> None:
    device = made_of(
        bench,
        "drivers.processing.opentrons_ot2:OpentronsOt2",
        "http://192.0.2.7:31950",
        pipette="p300_single_gen2",
        mount="left",
        deck={"1": "opentrons/opentrons_96_tiprack_300ul/1", "11": "opentrons/trough/1"},
        min_volume_ul=20.0,
        max_volume_ul=300.0,
        max_rate_ul_s=150.0,
    )
    assert device.nodes == {"liquid_handler": str(bench.node("new").id)}
    assert tree_of(bench, device) == {
        ("new", "liquid_handler", "bench_1"),
        ("new_pipette", "pipette_channel", "new"),
        ("new_deck", "deck", "new"),
        ("new_deck/1", "slot", "new_deck"),
        ("new_deck/11", "slot", "new_deck"),
    }
    services.rebuild(bench.lab)
    assert len(tree_of(bench, device)) == 5


def test_a_plate_reader_comes_with_its_drawer_and_heats_what_is_in_it(bench: Bench) -> None:
    device = made_of(
        bench,
        "drivers.characterization.molecular_devices_spectramax:MolecularDevicesSpectramax",
        "serial:///dev/ttyS0?baud=9600",
        model="plus_384",
        rest_temperature_c=20.0,
    )
    reader = str(bench.node("new").id)
    assert device.nodes == {"plate_reader": reader, "temperature_controller": reader}
    assert tree_of(bench, device) == {
        ("new", "plate_reader", "bench_1"),
        ("new_drawer", "slot", "new"),
    }
    assert bench.node("new").config == {"max_temperature_c": 45.0}
