"""A host sees in the readings that it takes anyway that what a completed action had set is gone."""

from __future__ import annotations

from collections.abc import Iterator
from uuid import UUID, uuid4

import msgspec
import pytest

from drivers.load import read_spec
from labweb.domain.enrollment.setpoint_readback import setting_actions
from labweb.domain.messages.commands import ResourceView
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from labweb.domain.runs.halts.halted_setpoints import RUN_ABORTED, owe_halt
from labweb.domain.runs.halts.standing_setpoints import StandingSetpoint, put_stands, read_stands
from labweb.domain.runs.host_journal.journal_rows import HeldResource
from tests.drivers.conformance.cases import HEATER_STIRRERS
from tests.drivers.conformance.placed_models import SPEED, Bench, Case, running
from tests.workers.bench import DEVICE_ID, Host, a_device, installed
from workers.base.system_clock import HostClock
from workers.journal.journal import Journal
from workers.line.device_unit import DeviceUnit
from workers.line.held_state_monitor import HeldStateMonitor
from workers.line.line_process import make_units
from workers.line.status_sampling import Sampler

PLATE: Case = HEATER_STIRRERS[0]
NODE = UUID(int=77)
MINUTE_S = 60.0 / SPEED + 4.0
"""A minute of lab time, and what a busy machine may add."""


@pytest.fixture(scope="module")
def plates() -> Iterator[Bench]:
    with running([PLATE]) as bench:
        yield bench


class Watching:
    """A line with one hotplate, and what its host knows that stands there."""

    def __init__(self, host: Host, bench: Bench) -> None:
        spec = read_spec(PLATE.dotted)
        self.host, self.bench = host, bench
        self.device: DeviceConfig = a_device(
            bench.url(PLATE),
            module=PLATE.dotted,
            class_name=spec.class_name,
            digest=spec.digest,
            config={**PLATE.config, "poll_s": 0.5},
            statuses={one.name: one.every_s for one in spec.statuses},
        )
        self.device = msgspec.structs.replace(self.device, nodes={"plate": NODE})
        self.clock = HostClock()
        self.units = make_units([self.device], self.clock, installed(), pace=SPEED)
        self.monitor = HeldStateMonitor(
            self.units, lambda: Journal(host.path), self.clock, pace=SPEED
        )
        self.sampler = Sampler(host.line, self.units, None, self.clock, self.monitor)
        self.sampler.sample_once()

    @property
    def unit(self) -> DeviceUnit:
        return self.units[self.device.id]

    def complete(self, action: str, args: dict[str, float]) -> None:
        """Carry an action out, and write down that it completed."""
        self.unit.act(action, dict(args))
        stands = StandingSetpoint(action_id=uuid4(), action=action, args=dict(args))
        with self.host.journal.write() as tx:
            put_stands(tx, self.device.id, "heat" if "heat" in action else "motion", stands)

    def sample_for(self, lab_s: float) -> list[str]:
        """Sample for so long, or until a loss is told; return what is told."""
        until_s = self.clock.monotonic_s() + lab_s / SPEED
        while self.clock.monotonic_s() < until_s and not self.told():
            self.sampler.sample_once()
            self.clock.wait(0.02)
        return self.told()

    def told(self) -> list[str]:
        bodies = [one.body for one in self.host.events() if one.kind == "setpoint_lost"]
        return [body["message"] for body in bodies]

    def close(self) -> None:
        self.unit.stop()
        self.unit.close()
        self.monitor.close()


@pytest.fixture
def line(host: Host, plates: Bench) -> Iterator[Watching]:
    plates.cure(PLATE)
    made = Watching(host, plates)
    assert made.device.id == DEVICE_ID
    try:
        yield made
    finally:
        plates.cure(PLATE)
        made.close()


def test_a_device_that_restarts_between_two_steps_is_told_of_within_a_minute(
    line: Watching,
) -> None:
    line.complete("stir", {"speed_rpm": 400.0})
    assert line.sample_for(60.0) == []
    line.bench.inflict(PLATE, "restart")
    (text,) = line.sample_for(60.0 + 4.0 * SPEED)
    assert text.startswith(("the speed set-point reads 0 rpm", "the speed reads 0 rpm"))
    assert read_stands({"stands": line.host.journal.meta("stands") or "{}"}) == {}


def test_a_stirrer_that_stalls_between_two_steps_is_told_of_within_a_minute(
    line: Watching,
) -> None:
    line.complete("stir", {"speed_rpm": 400.0})
    assert line.sample_for(20.0) == []
    line.bench.inflict(PLATE, "stall")
    (text,) = line.sample_for(60.0 + 4.0 * SPEED)
    assert text == (
        "the speed reads 0 rpm; 400 rpm was set: what it moves is blocked, or the motor is off"
    )


def test_a_knob_that_somebody_turns_between_two_steps_is_told_of_within_a_minute(
    line: Watching,
) -> None:
    line.complete("heat_to", {"temperature_c": 40.0, "tolerance_c": 5.0})
    assert line.sample_for(20.0) == []
    line.bench.inflict(PLATE, "knob", temperature_c=90.0)
    (text,) = line.sample_for(60.0 + 4.0 * SPEED)
    assert text.startswith("the temperature set-point reads 90 °C; 40 °C was set")


def test_the_hosts_record_says_that_what_was_set_is_unknown(line: Watching) -> None:
    view = ResourceView(
        id=NODE, name="plate", kind="vessel", rev=3, data={"speed_setpoint_rpm": 400.0}
    )
    with line.host.journal.write() as tx:
        tx.put_resource(HeldResource(view=view, quarantined_by=None))
    line.complete("stir", {"speed_rpm": 400.0})
    line.sample_for(10.0)
    line.bench.inflict(PLATE, "restart")
    assert line.sample_for(60.0 + 4.0 * SPEED)
    with line.host.journal.write() as tx:
        held = tx.resource(NODE)
    assert held is not None
    assert (held.view.data, held.view.rev) == ({"speed_setpoint_rpm": None}, 4)


def test_readings_that_show_whether_something_stands_are_taken_more_often(
    line: Watching,
) -> None:
    line.complete("stir", {"speed_rpm": 400.0})
    line.sample_for(20.0)
    assert line.monitor.period_s(line.unit, "speed_setpoint_rpm", 30.0) == 0.2
    assert line.monitor.period_s(line.unit, "temperature_c", 30.0) == 30.0


def test_what_an_action_of_the_same_sort_does_meanwhile_is_no_loss(line: Watching) -> None:
    line.complete("stir", {"speed_rpm": 400.0})
    line.sample_for(10.0)
    line.unit.acting = "stir"
    line.unit.driver.pace = SPEED
    line.bench.inflict(PLATE, "knob", speed_rpm=200.0)
    assert line.sample_for(120.0) == []
    assert "stir" in setting_actions()


def test_what_a_halt_takes_away_that_is_under_way_is_no_loss(line: Watching) -> None:
    line.complete("stir", {"speed_rpm": 400.0})
    assert line.sample_for(20.0) == []
    with line.host.journal.write() as tx:
        owe_halt(tx, line.device.id, RUN_ABORTED, None)
    line.unit.stop()
    assert line.sample_for(60.0) == []
