"""Parts that lie in parts of a device go and come with them, once nothing of the lab is there."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from uuid import UUID

import pytest
from pytest_django import Settings

from labweb.common.signatures import authority
from labweb.crutd import services as crutd_services
from labweb.crutd.selectors.history_replay import rebuild_differences
from labweb.domain.crutd import operations
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.models import Device, DriverVersion
from labweb.resources.models import Resource
from tests.builders import Bench, an_edge
from tests.labweb.crutd.test_adopting import adopted, wanted
from tests.labweb.enrollment.test_discovery import seen
from tests.labweb.fleet.test_driver_replacement import a_pump
from tests.labweb.fleet.test_parts_of_versions import codes, give

INNER = {
    "pump_9_liquid_handler",
    "pump_9_liquid_handler_pipette",
    "pump_9_liquid_handler_deck",
    "pump_9_injection_valve",
    "pump_9_injection_valve_loop",
}


@pytest.fixture(autouse=True)
def _own_authority(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


def with_roles(bench: Bench, *roles: str) -> DriverVersion:
    version = a_pump(bench, " ".join(roles))
    spec = {**version.spec, "roles": list(roles)}
    DriverVersion.objects.filter(pk=version.pk).update(spec=spec)
    version.refresh_from_db()
    return version


@pytest.fixture
def station(bench: Bench) -> Device:
    """A pump with an injection valve and a deck; no line serves it."""
    version = with_roles(bench, "pump", "injection_valve", "liquid_handler")
    wish = wanted(bench)
    device = adopted(
        bench,
        seen(bench, an_edge(bench)),
        type(wish)(
            name=wish.name,
            driver_digest=version.digest,
            transport=wish.transport,
            config=wish.config,
        ),
    )
    return enrollment_services.admit_device(
        device.id, actor=bench.people["admin"], reason="looked at it"
    )


def in_service(bench: Bench) -> set[str]:
    above = {row.id: row.parent_id for row in Resource.objects.all()}
    archive = bench.node("archive").id

    def is_kept(node: UUID | None) -> bool:
        return node is not None and (node == archive or is_kept(above[node]))

    rows = Resource.objects.filter(key__in=INNER)
    return {row.key for row in rows if not is_kept(row.id)}


def test_what_lies_in_a_part_goes_with_it_and_comes_back(bench: Bench, station: Device) -> None:
    before, alone = station.driver, with_roles(bench, "pump")
    assert in_service(bench) == INNER
    assert bench.node("pump_9_injection_valve_loop").parent == bench.node("pump_9_injection_valve")
    Device.objects.filter(pk=station.pk).update(state="suspended")
    give(bench, station, alone)
    assert in_service(bench) == set()
    assert rebuild_differences(bench.lab) == []
    give(bench, bench.device("pump_9"), before)
    assert in_service(bench) == INNER
    assert bench.node("pump_9_injection_valve_loop").parent == bench.node("pump_9_injection_valve")
    assert rebuild_differences(bench.lab) == []


def test_a_loop_that_holds_something_keeps_its_valve(bench: Bench, station: Device) -> None:
    move = operations.TransferLiquid(
        source_id=bench.node("water").id,
        target_id=bench.node("pump_9_injection_valve_loop").id,
        amount_nl=10_000,
    )
    Resource.objects.filter(key="pump_9_injection_valve_loop").update(config={"capacity_ul": 20.0})
    crutd_services.carry_out(move, lab=bench.lab, actor_id=bench.people["admin"].pk)
    assert codes(bench, station, with_roles(bench, "pump")) == {"crutd.holds_matter"}


def test_a_flask_on_its_deck_keeps_the_robot(bench: Bench, station: Device) -> None:
    bench.unplug("flask_2")
    flask = bench.node("flask_2")
    flask.parent = bench.node("pump_9_liquid_handler_deck")
    flask.save()
    assert codes(bench, station, with_roles(bench, "pump")) == {"crutd.occupied"}
