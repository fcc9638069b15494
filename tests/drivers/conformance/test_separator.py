"""What every separator does with two real layers: chloroform-like below, water above."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from drivers.base import DeviceStoppedError
from drivers.load import read_statuses
from drivers.processing.chinwe_separator import ChinweSeparator
from drivers.transports.urls import make_transport
from labweb.domain.errors import DeviceError, Effect, RejectedError
from tests.drivers.conformance.placed_models import Doing
from tests.fixtures.hand_bench import Json, a_document
from tests.fixtures.running import Process, until

LOWER_UL, UPPER_UL = 4000.0, 6000.0
SUBSTANCES = {
    "water": {"density_mg_ul": 0.998, "molar_mass_g_mol": 18.02, "layer": "water"},
    "dichloromethane": {"density_mg_ul": 1.33, "molar_mass_g_mol": 84.93},
}
CONFIG = {
    "vessel_ul": 25_000.0,
    "max_speed_rpm": 500.0,
    "low_count": 200,
    "threshold_count": 350,
    "high_count": 500,
    "drain_rate_ul_s": 1640.0,
    "tolerance_ratio": 0.25,
    "valve_limit_s": 1.0,
    "poll_s": 0.02,
}
DRAIN = ("drain_lower_phase", {"volume_ul": LOWER_UL, "reading": "rises"})


class Rig:
    """A separator with two layers, at ten times the speed of life."""

    def __init__(self, process: Process) -> None:
        self.process = process
        self.device = self.driver()
        self.device.connect()
        self.device.confirm_drain_closed()

    def driver(self) -> ChinweSeparator:
        transport = make_transport(f"tcp://127.0.0.1:{self.process.port_of('it')}")
        return ChinweSeparator(transport, CONFIG)  # type: ignore[arg-type]

    def held_ul(self, vessel: str) -> dict[str, float]:
        found = self.process.get("/world")["vessels"][vessel]
        return {lot: volume_nl / 1000 for lot, volume_nl in found["contents"].items()}

    def inflict(self, fault: str, **options: object) -> None:
        path = "/instruments/it/faults"
        assert self.process.call("POST", path, {"fault": fault, **options})[0] == 201

    def tells(self, name: str) -> Any:  # noqa: ANN401 - whatever the instrument has
        return self.process.get("/instruments/it")["state"][name]

    def begin(self) -> Doing:
        doing = Doing(self.device, DRAIN)
        until(lambda: self.tells("opening") == 1.0)
        return doing


@pytest.fixture
def rig() -> Iterator[Rig]:
    lots = [("dichloromethane", LOWER_UL, 1.33), ("water", UPPER_UL, 0.998)]
    funnel: Json = {
        "id": "funnel",
        "capacity_ul": 25_000,
        "contents": [
            {"lot": lot, "volume_ul": volume, "density_mg_ul": density}
            for lot, volume, density in lots
        ],
    }
    entry: Json = {
        "id": "it",
        "model": "chinwe_separator",
        "endpoint": "tcp:127.0.0.1:0",
        "settings": {"drain_ul_s": 200.0, "settling_tau_s": 4.0},
        "attached": {"ports": {"vessel": {"vessel": "funnel"}, "outlet": {"vessel": "receiver"}}},
    }
    receiver: Json = {"id": "receiver", "capacity_ul": 50_000, "contents": []}
    document = a_document(entry, vessels=[funnel, receiver])
    with TemporaryDirectory(prefix="lw") as name:
        process = Process(Path(name))
        text = json.dumps(document | {"chemistry": {"substances": SUBSTANCES}})
        process.folder.joinpath("bench.json").write_text(text)
        process.start("--speed", "10")
        try:
            rig = Rig(process)
            yield rig
            rig.device.close()
        finally:
            process.stop()


def test_the_lower_phase_is_in_the_receiver_and_the_upper_one_is_not(rig: Rig) -> None:
    report = rig.device.drain_lower_phase(LOWER_UL, "rises")
    assert report.moved_ul == pytest.approx(LOWER_UL, rel=0.25)
    received = rig.held_ul("receiver")
    assert received["dichloromethane"] == pytest.approx(LOWER_UL, rel=0.01)
    assert received.get("water", 0.0) < 0.15 * UPPER_UL
    assert rig.tells("valve_deg") == pytest.approx(0.0, abs=2.0)
    assert report.evidence["is_drain_closed"] is True


def test_phases_that_were_stirred_are_not_drained_before_they_have_settled(rig: Rig) -> None:
    rig.device.stir(300.0, 0.2)
    assert rig.device.speed_rpm() == 0.0
    with pytest.raises(RejectedError) as caught:
        rig.device.drain_lower_phase(LOWER_UL, "rises")
    assert (caught.value.code, caught.value.effect) == ("device.not_settled", Effect.NONE)
    assert rig.held_ul("receiver") == {}
    until(lambda: rig.tells("emulsified") < 0.01, 10)
    assert rig.device.drain_lower_phase(LOWER_UL, "rises").moved_ul is not None


@pytest.mark.parametrize("recorded_ul", [1500.0, 9000.0])
def test_a_record_that_is_wrong_is_not_confirmed(rig: Rig, recorded_ul: float) -> None:
    with pytest.raises(DeviceError) as caught:
        rig.device.drain_lower_phase(recorded_ul, "rises")
    assert (caught.value.code, caught.value.effect) == ("device.no_boundary", Effect.UNKNOWN)
    assert "moved_ul" not in caught.value.context
    assert rig.tells("opening") == 0.0


def test_the_other_direction_is_refused_by_the_first_look(rig: Rig) -> None:
    with pytest.raises(RejectedError) as caught:
        rig.device.drain_lower_phase(LOWER_UL, "falls")
    assert caught.value.code == "device.not_settled"


def test_a_stop_closes_the_drain_and_claims_no_volume(rig: Rig) -> None:
    doing = rig.begin()
    rig.device.stop()
    error = doing.failure()
    assert isinstance(error, DeviceStoppedError)
    assert error.effect is Effect.PARTIAL
    assert error.context["is_drain_closed"] is True
    assert "moved_ul" not in error.context
    assert rig.tells("opening") == 0.0


def test_a_valve_that_sticks_on_its_way_back_is_said_out_loud(rig: Rig) -> None:
    doing = rig.begin()
    rig.inflict("valve_overload", match={"port": "outlet"}, repeat=True)
    error = doing.failure()
    assert (error.code, error.effect) == ("device.drain_open", Effect.UNKNOWN)
    assert "may be open" in error.message
    assert rig.device.is_drain_closed() is False
    assert rig.tells("opening") > 0.0


def test_a_frozen_sensor_never_sees_the_boundary_and_the_drain_closes(rig: Rig) -> None:
    doing = rig.begin()
    rig.inflict("frozen")
    error = doing.failure()
    assert (error.code, error.effect) == ("device.no_boundary", Effect.UNKNOWN)
    assert rig.tells("opening") == 0.0


def test_power_that_comes_back_with_the_drain_open_is_no_closed_drain(rig: Rig) -> None:
    doing = rig.begin()
    rig.inflict("power_loss", for_s=8.0)
    error = doing.failure()
    assert (error.code, error.effect) == ("device.drain_open", Effect.UNKNOWN)
    until(lambda: "is_drain_closed" in told(rig))
    assert told(rig)["is_drain_closed"] is None
    assert rig.tells("opening") == 1.0
    with pytest.raises(DeviceError, match="not shown to be closed"):
        rig.device.drain_lower_phase(LOWER_UL, "rises")


def test_a_driver_that_begins_beside_a_motor_that_begins_claims_no_closed_drain(rig: Rig) -> None:
    rig.begin()
    rig.inflict("power_loss", for_s=8.0)
    until(lambda: "is_drain_closed" in told(rig))
    rig.device.close()
    anew = rig.driver()
    anew.connect()
    assert rig.tells("opening") == 1.0
    assert anew.is_drain_closed() is None
    with pytest.raises(RejectedError, match="confirm that it is closed"):
        anew.drain_lower_phase(LOWER_UL, "rises")
    with pytest.raises(DeviceError) as caught:
        anew.close_drain()
    assert (caught.value.code, caught.value.effect) == ("device.drain_open", Effect.UNKNOWN)
    anew.close()


def told(rig: Rig) -> dict[str, Any]:
    try:
        return dict(read_statuses(rig.device))
    except DeviceError:
        return {}
