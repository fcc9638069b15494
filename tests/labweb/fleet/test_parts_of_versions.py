"""A version of a driver that adds or removes parts: decided by a person, one transaction."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from uuid import uuid4

import msgspec
import pytest
from django.db.transaction import atomic
from pytest_django import Settings

from labweb.common.clock import now
from labweb.common.signatures import authority
from labweb.crutd import services as crutd_services
from labweb.crutd.models import Event, Transaction
from labweb.crutd.selectors.history_replay import as_it_was, rebuild_differences
from labweb.domain.crutd import operations
from labweb.domain.crutd.device_parts_refit import check_refit
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.errors import PreconditionError
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.models import Device, DriverVersion
from labweb.fleet.services import driver_replacement
from labweb.resources.models import Connection, Resource
from labweb.runs.models import Job
from tests.builders import Bench, Edge, a_started_run, an_edge
from tests.labweb.crutd.test_adopting import adopted
from tests.labweb.enrollment.test_discovery import seen
from tests.labweb.fleet.test_driver_replacement import a_pump, ready
from tests.labweb.web import call, read, signed_in

ALONE = {"Config], Pump, Valve)": "Config], Pump)"}


@pytest.fixture(autouse=True)
def _own_authority(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


@pytest.fixture
def edge(bench: Bench) -> Edge:
    return an_edge(bench)


@pytest.fixture
def pump(bench: Bench, edge: Edge) -> Device:
    """A pump with the valve that came with it, admitted; nothing is connected from outside."""
    device = adopted(bench, seen(bench, edge))
    return enrollment_services.admit_device(
        device.id, actor=bench.people["admin"], reason="looked at it"
    )


def alone(bench: Bench) -> DriverVersion:
    return a_pump(bench, "alone", **ALONE)


def give(bench: Bench, device: Device, version: DriverVersion, parts: str | None = None) -> Device:
    shown = driver_replacement.look_at_parts(device.id, version.id).decision
    return driver_replacement.replace_driver(
        device.id,
        version.id,
        actor=bench.people["admin"],
        reason="the valve is broken off",
        parts=shown if parts is None else parts,
    )


def codes(bench: Bench, device: Device, version: DriverVersion) -> set[str]:
    with pytest.raises(PreconditionError) as refusal:
        give(bench, device, version)
    return {one.code for one in refusal.value.findings}


def test_a_part_that_goes_is_kept_in_the_archive_and_comes_back_with_the_version_before(
    bench: Bench, edge: Edge, pump: Device
) -> None:
    valve, before = bench.node("pump_9_valve"), pump.driver
    version = alone(bench)
    pump = give(bench, pump, version)
    assert not bench.node("pump_9_valve").is_archived, "its host has not built it yet"
    ready(edge, pump, version)
    pump = bench.device("pump_9")
    gone = bench.node("pump_9_valve")
    assert (pump.driver, pump.next_parts) == (version, {})
    assert (gone.is_archived, gone.parent) == (True, bench.node("archive"))
    assert pump.nodes == {"pump": str(bench.node("pump_9").id)}
    assert not Connection.objects.filter(target=valve).exists()
    ready(edge, give(bench, pump, before), before)
    pump, back = bench.device("pump_9"), bench.node("pump_9_valve")
    assert (back.id, back.is_archived, back.parent_id) == (valve.id, False, valve.parent_id)
    assert pump.nodes == {"pump": str(bench.node("pump_9").id), "valve": str(valve.id)}
    tube = Connection.objects.get(target=valve)
    assert (tube.source_port, tube.target_port, tube.medium) == ("outlet", "common", "liquid")


def test_the_change_is_one_transaction_that_rebuild_and_the_past_know(
    bench: Bench, edge: Edge, pump: Device
) -> None:
    version, before, at = alone(bench), pump.driver, now()
    count = Transaction.objects.count()
    ready(edge, give(bench, pump, version), version)
    assert Transaction.objects.count() == count + 1
    event = Event.objects.latest("seq")
    assert (event.name, event.body["operation"]["op"]) == ("update", "refit")
    assert event.body["actor_id"] == str(bench.people["admin"].pk)
    assert "the valve is broken off" in event.body["message"]
    Resource.objects.filter(key="pump_9_valve").update(is_archived=False)
    crutd_services.rebuild(bench.lab)
    assert bench.node("pump_9_valve").is_archived
    assert not Connection.objects.filter(key="pump_9_pump_9_valve").exists()
    ready(edge, give(bench, bench.device("pump_9"), before), before)
    Connection.objects.filter(key="pump_9_pump_9_valve").delete()
    crutd_services.rebuild(bench.lab)
    assert rebuild_differences(bench.lab) == []
    assert Connection.objects.filter(key="pump_9_pump_9_valve").exists()
    client, valve = signed_in(bench.people["admin"]), bench.node("pump_9_valve").id
    told = json.dumps(read(client, f"/api/v1/resources/{valve}/provenance"))
    assert "wasInvalidatedBy" in told, "it went"
    then = {row.key: row for row in as_it_was(bench.lab, at, now=now()).rows}
    assert not then["pump_9_valve"].is_archived


def test_a_tube_of_the_lab_file_that_went_does_not_come_back_with_a_rebuild(
    bench: Bench, edge: Edge
) -> None:
    device, version = bench.device("pump_1"), alone(bench)
    inner = "pump_1_valve_1"
    Connection.objects.exclude(key=inner).filter(source__key="valve_1").delete()
    Connection.objects.exclude(key=inner).filter(target__key="valve_1").delete()
    valve = bench.node("valve_1")
    ready(edge, give(bench, device, version), version)
    assert bench.node("valve_1").is_archived
    crutd_services.rebuild(bench.lab)
    assert not Connection.objects.filter(key=inner).exists()
    release = device.driver
    ready(edge, give(bench, bench.device("pump_1"), release), release)
    assert bench.node("valve_1").id == valve.id
    assert not bench.node("valve_1").is_archived
    assert bench.device("pump_1").nodes == device.nodes
    assert rebuild_differences(bench.lab) == []


def test_a_part_that_is_new_stands_beside_the_others(bench: Bench, edge: Edge) -> None:
    """A pump that was taken up alone gets a valve with the next version."""
    admin = bench.people["admin"]
    version = alone(bench)
    device = adopted(bench, seen(bench, edge))
    give(bench, device, version)
    first = bench.device("pump_9")
    assert first.driver == version, "nothing serves it: it has the version at once"
    Device.objects.filter(pk=device.id).update(past_nodes={})
    valve = bench.node("pump_9_valve")
    Resource.objects.filter(pk=valve.id).update(kind="slot")
    enrollment_services.admit_device(device.id, actor=admin, reason="looked")
    both = a_pump(bench, "both")
    ready(edge, give(bench, bench.device("pump_9"), both), both)
    made = bench.node("pump_9_rotary_valve")
    assert (made.kind, made.config["ports_count"]) == ("rotary_valve", 8)
    assert made.parent_id == bench.node("pump_9").parent_id
    assert bench.device("pump_9").nodes["valve"] == str(made.id)


def test_settings_of_a_part_follow_the_version(bench: Bench, edge: Edge, pump: Device) -> None:
    version = a_pump(bench, "ten ports")
    config = [
        {**one, "default": 10} if one["name"] == "ports_count" else one
        for one in version.spec["config"]
    ]
    DriverVersion.objects.filter(pk=version.pk).update(spec={**version.spec, "config": config})
    rest = {name: value for name, value in pump.config.items() if name != "ports_count"}
    Device.objects.filter(pk=pump.pk).update(config=rest)
    before = bench.node("pump_9_valve")
    ready(edge, give(bench, pump, version), version)
    after = bench.node("pump_9_valve")
    assert (after.config["ports_count"], after.rev) == (10, before.rev + 1)
    assert rebuild_differences(bench.lab) == []


def test_who_was_shown_other_parts_has_decided_nothing(bench: Bench, pump: Device) -> None:
    version = alone(bench)
    for parts in ("", "0" * 64):
        with pytest.raises(PreconditionError) as refusal:
            give(bench, pump, version, parts)
        found = {(one.code, one.subject) for one in refusal.value.findings}
        assert ("driver.parts_lost", "pump_9_valve") in found
    assert bench.device("pump_9").next_driver is None


def test_a_part_that_goes_is_refused_while_it_is_connected(bench: Bench) -> None:
    assert "crutd.connected" in codes(bench, bench.device("pump_1"), alone(bench))


def test_a_part_that_goes_is_refused_while_it_is_reserved(bench: Bench, pump: Device) -> None:
    crutd_services.reserve(
        [bench.node("pump_9_valve").id],
        holder_id=bench.people["admin"].pk,
        lasts=timedelta(hours=1),
        reason="mine",
    )
    assert codes(bench, pump, alone(bench)) == {"crutd.reserved"}


def test_a_part_that_goes_is_refused_while_it_holds_matter(bench: Bench, pump: Device) -> None:
    """The version has a valve alone, and the syringe is full."""
    water = bench.node("water")
    move = operations.TransferLiquid(
        source_id=water.id, target_id=bench.node("pump_9").id, amount_nl=1_000_000
    )
    crutd_services.carry_out(move, lab=bench.lab, actor_id=bench.people["admin"].pk)
    version = a_pump(bench, "no pump")
    spec = {**version.spec, "roles": ["valve"]}
    DriverVersion.objects.filter(pk=version.pk).update(spec=spec)
    assert "crutd.holds_matter" in codes(bench, pump, version)


def test_a_part_that_a_run_will_still_use_stays(bench: Bench, pump: Device) -> None:
    run = a_started_run(bench)
    job = run.jobs.exclude(device=pump).first()
    assert job is not None
    Job.objects.filter(pk=job.pk).update(locks=[str(bench.node("pump_9_valve").id)])
    assert codes(bench, pump, alone(bench)) == {"driver.still_needed"}


def test_what_became_connected_meanwhile_leaves_the_version_before_in_place(
    bench: Bench, edge: Edge, pump: Device
) -> None:
    version, before = alone(bench), pump.driver
    pump = give(bench, pump, version)
    Connection.objects.create(
        lab=bench.lab,
        key="late",
        source=bench.node("pump_9_valve"),
        source_port="3",
        target=bench.node("waste"),
        medium="liquid",
    )
    ready(edge, pump, version)
    pump = bench.device("pump_9")
    assert (pump.driver, pump.next_driver, pump.next_parts) == (before, None, {})
    assert "late" in pump.driver_problem["message"]
    assert not bench.node("pump_9_valve").is_archived


def test_a_part_in_use_is_waited_for(bench: Bench, edge: Edge, pump: Device) -> None:
    version, valve = alone(bench), bench.node("pump_9_valve")
    pump = give(bench, pump, version)
    held = crutd_services.lock_operation(
        operations.Update(resource_id=valve.id, data={"x": 1}),
        lab=bench.lab,
        targets=(),
        actor_id=None,
    )
    ready(edge, pump, version)
    pump = bench.device("pump_9")
    assert (pump.next_driver, pump.is_next_ready) == (version, True)
    done = crutd_services.Settlement(outcome=Outcome(kind=OutcomeKind.DONE))
    crutd_services.settle(held.pk, done)
    assert driver_replacement.switch_waiting() == 1
    assert bench.device("pump_9").driver == version
    assert bench.node("pump_9_valve").is_archived


def test_the_page_shows_what_comes_and_goes_and_hands_the_decision_back(
    bench: Bench, pump: Device
) -> None:
    version, client = alone(bench), signed_in(bench.people["admin"])
    path = f"/api/v1/devices/{pump.id}/driver"
    shown = read(client, f"{path}/{version.id}/parts")
    assert {one["code"] for one in shown["changes"]} == {"driver.parts_lost"}
    assert shown["findings"] == []
    body = {"version_id": str(version.id), "reason": "broken"}
    assert call(client, "POST", path, body).status_code == 412
    assert call(client, "POST", path, {**body, "parts": shown["decision"]}).status_code == 200
    observer = signed_in(bench.people["observer"])
    assert call(observer, "GET", f"{path}/{version.id}/parts").status_code == 403


def test_a_tube_whose_key_is_taken_is_refused_before_anything_is_written(
    bench: Bench, edge: Edge, pump: Device
) -> None:
    before, version = pump.driver, alone(bench)
    ready(edge, give(bench, pump, version), version)
    other(bench, "pump_9_pump_9_valve")
    device = bench.device("pump_9")
    shown = driver_replacement.look_at_parts(device.id, before.id).findings
    assert [(one.code, one.subject) for one in shown] == [("crutd.taken", "pump_9_pump_9_valve")]
    assert codes(bench, device, before) == {"crutd.taken"}


def test_parts_and_tubes_that_come_with_one_key_twice_are_refused(bench: Bench) -> None:
    water, waste = bench.node("water"), bench.node("waste")
    part = operations.Create(
        resource_id=uuid4(), parent_id=water.id, key="twin", name="Twin", kind="slot", config={}
    )
    tube = operations.Joint(
        id=uuid4(),
        key="hose",
        source_id=water.id,
        source_port="1",
        target_id=waste.id,
        target_port="",
        medium="liquid",
    )
    refit = operations.Refit(
        device_id=bench.device("pump_1").id,
        anchor_id=water.id,
        digest="0" * 64,
        added=(part, msgspec.structs.replace(part, resource_id=uuid4())),
        joined=(tube, msgspec.structs.replace(tube, id=uuid4())),
    )
    found = [one for one in check_refit(refit, {}, None) if one.code == "crutd.taken"]
    assert [one.subject for one in found] == ["twin", "hose"]


def test_what_the_database_refuses_leaves_the_version_before_and_the_host_in_service(
    bench: Bench, edge: Edge, pump: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    version, before = alone(bench), pump.driver
    pump = give(bench, pump, version)

    @atomic
    def refused(*_: object, **__: object) -> None:
        other(bench, "pump_9_pump_9_valve")

    monkeypatch.setattr(crutd_services, "refit_device", refused)
    ready(edge, pump, version)
    assert enrollment_services.record_of(bench.host).quarantine == ""
    pump = bench.device("pump_9")
    assert (pump.driver, pump.next_driver) == (before, None)
    assert "the database refuses" in pump.driver_problem["message"]


def other(bench: Bench, key: str) -> None:
    """Connect two things elsewhere under a key."""
    Connection.objects.create(
        lab=bench.lab,
        key=key,
        source=bench.node("water"),
        target=bench.node("waste"),
        medium="liquid",
    )
