"""Separator of the ChinWe workstation: a stirrer, a drain valve and a level sensor on one bus.

Protocol: RS-485 through a serial server (TCP 8899) or a port, 9600 8N1; Emm_V5.0, Modbus RTU.
Quality: bronze, simulated instrument.
Safe state: drain closed, stirrer stands; on a lost link both stay: an open drain goes on running.

Gravity drains and nothing meters it: two witnesses have to agree on what went, the boundary at the
neck and the time by the lab's own drain rate. Whether the drain is closed is read back from where
a person has confirmed that it is (`_drain`): a motor does not know where it stood without power.

Source:
    Uni-Lab-OS, public device file `unilabos/devices/separator/chinwe.py`: bus, addresses, roles,
    800 pulses for a quarter turn; frames in `_emm` and `_xkc`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from drivers.base import DeviceStoppedError, Driver, Range, Report, action, before_acting, status
from drivers.interfaces.separator import Separator
from drivers.processing._drain import LOOK, Drain, DrainRun, make_ready, planned
from drivers.processing._emm import HAS_STALLED, IS_ENABLED, IS_PROTECTED, Motor
from drivers.processing._xkc import LevelReading, LevelSensor
from drivers.transports.base import ByteTransport
from drivers.waiting import (
    WantedReading,
    await_reading,
    once_started,
    refuse_between_steps,
    refuse_beyond,
    watch_reading,
)
from labweb.domain.errors import (
    DefinitionError,
    DeviceError,
    Effect,
    RejectedError,
)

SPEED_TOLERANCE_RPM = 5.0
SETTLED_LOOKS = 5
"""Readings in a row that a settled phase gives at the neck."""

STANDING_RPM = 0.5

Volume = Annotated[float, Range(1.0, 10_000_000.0)]
Count = Annotated[int, Range(0, 65_535)]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One separator; what the phases give at the neck, and how fast they run, the lab measures."""

    vessel_ul: Volume
    """What the vessel holds."""

    max_speed_rpm: Annotated[float, Range(1.0, 3000.0)]
    """Fastest stirring that the vessel stands."""

    low_count: Count
    """Signal at the neck: at most so much is the phase that gives less, settled."""

    threshold_count: Count
    """Where the boundary is, between the two."""

    high_count: Count
    """At least so much is the phase that gives more, settled."""

    drain_rate_ul_s: Annotated[float, Range(0.1, 1_000_000.0)]
    """What runs out of the open drain, as the lab has measured it with its liquids."""

    tolerance_ratio: Annotated[float, Range(0.001, 0.5)]
    """How far time by rate may be from the volume of a drain, of that volume."""

    opens: Literal["CW", "CCW"] = "CW"
    """Sense of rotation that opens the drain."""

    stirs: Literal["CW", "CCW"] = "CW"
    stirrer_index: Annotated[int, Range(1, 255)] = 4
    valve_index: Annotated[int, Range(1, 255)] = 5
    sensor_index: Annotated[int, Range(1, 254)] = 6
    """Addresses on the bus."""

    valve_speed_rpm: Annotated[int, Range(1, 300)] = 30
    acceleration_index: Annotated[int, Range(0, 255)] = 200
    """Ramp of the stirrer: each rpm takes (256 - this) times 50 µs; at 0 there is no ramp."""

    speed_limit_s: Annotated[float, Range(0.1, 100.0)] = 60.0
    """Longest time to reach a speed, or to stand."""

    grace_s: Annotated[float, Range(0.0, 600.0)] = 5.0
    """How long the speed may leave its tolerance."""

    valve_limit_s: Annotated[float, Range(0.1, 60.0)] = 5.0
    """Longest quarter turn."""

    poll_s: Annotated[float, Range(0.005, 5.0)] = 0.1


class ChinweSeparator(Driver[ByteTransport, Config], Separator):
    """One separator: three units of one bus."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def __init__(self, transport: ByteTransport, config: Mapping[str, Any]) -> None:
        """Hold transport and settings.

        Raises:
            DefinitionError: As the base class; the signals are not in order, or two units
                have one address.
        """
        super().__init__(transport, config)
        own = self.config
        if not own.low_count < own.threshold_count < own.high_count:
            raise DefinitionError(
                f"low_count {own.low_count}, threshold_count {own.threshold_count} and high_count "
                f"{own.high_count} have to rise",
                code="driver.config",
            )
        units = (own.stirrer_index, own.valve_index, own.sensor_index)
        if len({*units}) < len(units):
            raise DefinitionError(f"addresses {units} are not all different", code="driver.config")
        self._stirrer = Motor(transport, own.stirrer_index)
        self._sensor = LevelSensor(transport, own.sensor_index)
        self._drain = Drain(
            driver=self,
            motor=Motor(transport, own.valve_index),
            opens=own.opens,
            speed_rpm=own.valve_speed_rpm,
            limit_s=own.valve_limit_s,
            poll_s=own.poll_s,
        )

    def identify(self) -> None:
        """Ask the three units who they are. Nothing moves."""
        self._stirrer.identify()
        self._drain.motor.identify()
        self._sensor.identify()

    def halt(self) -> None:
        """Close the drain, then stop the stirrer; return once the drain is shown to be closed."""
        try:
            self._drain.begin_to_close()
        finally:
            self._stop_stirrer()
        self._drain.make_sure()

    @status(every_s=2.0)
    def speed_rpm(self) -> float:
        """Tell the speed of the stirrer, whichever way it turns."""
        return float(abs(self._stirrer.speed_rpm()))

    @status(every_s=2.0)
    def is_drain_closed(self) -> bool | None:
        """Tell whether the valve is at its zero; None: nobody knows where its zero is."""
        return self._drain.is_closed()

    @status(every_s=2.0)
    def neck_signal_count(self) -> int:
        """Tell the signal strength of the sensor at the neck."""
        return self._sensor.level().signal

    @status(every_s=2.0)
    def has_liquid_at_neck(self) -> bool:
        """Tell whether the sensor sees liquid of any phase."""
        return self._sensor.level().has_liquid

    @action(timeout_s=90_000.0, recovery="R1", hazards=("moving_parts",))
    def stir(
        self,
        speed_rpm: Annotated[float, Range(1.0, 3000.0)],
        duration_s: Annotated[float, Range(0.1, 86_400.0)],
    ) -> Report:
        """Stir for a time with the drain closed, and return once the stirrer stands.

        Raises:
            PreconditionError: Faster than this lab allows, or no whole number of rpm (NONE).
            RejectedError: The drain is not shown to be closed, or a motor is in alarm (NONE).
            DeviceError: Speed not reached or not held, stalled, or stopped: the stirrer stands
                (PARTIAL); after a lost answer UNKNOWN.

        Effect:
            The phases are mixed, and have not settled yet.
        """
        self.refuse_if_stopped()
        refuse_beyond("speed", speed_rpm, 0.0, self.config.max_speed_rpm)
        turns = refuse_between_steps("speed", speed_rpm, 1.0)
        with before_acting():
            self._drain.refuse_unless_closed()
            make_ready(self._stirrer)
        self._begin_to_turn(turns)
        wanted = WantedReading(speed_rpm, min(SPEED_TOLERANCE_RPM, speed_rpm / 2), "rpm")
        own, poll_s = self.config, self.config.poll_s
        with once_started(self._stop_stirrer, self._speed, driver=self):
            await_reading(self, self._turning, wanted, limit_s=own.speed_limit_s, poll_s=poll_s)
            began_s = self.now_s()
            times = {"duration_s": duration_s, "poll_s": poll_s, "grace_s": own.grace_s}
            watch_reading(self, self._turning, wanted, **times)
            stirred_s = round(self.now_s() - began_s, 3)
            self._stop_stirrer()
            return Report(evidence={**self._speed(), "stirred_s": stirred_s})

    @action(timeout_s=3600.0, recovery="R3", hazards=("expels_liquid",), operation="transfer")
    def drain_lower_phase(self, volume_ul: Volume, reading: Literal["falls", "rises"]) -> Report:
        """Let the lower phase out, and close the drain when the boundary is at the neck.

        Raises:
            PreconditionError: More than the vessel holds, too little to be told from nothing, or
                too much for the time limit (NONE).
            RejectedError: The stirrer turns, the drain is not shown to be closed, a motor is in
                alarm, or what is at the neck is no settled lower phase (NONE).
            DeviceStoppedError: The drain is closed; `by_time_ul` has run if the rate was true, and
                nobody has seen it (PARTIAL, without `moved_ul`).
            DeviceError: The boundary was not seen, or not when the rate says; a unit of the bus
                failed; or the drain is not shown to be closed, `device.drain_open` (UNKNOWN).

        Effect:
            `moved_ul` by time and rate has run out, which agrees with what was asked; the ledger
            writes what was asked. The drain is closed.
        """
        self.refuse_if_stopped()
        own = self.config
        refuse_beyond("volume", volume_ul, 0.0, own.vessel_ul)
        run = planned(
            volume_ul,
            falls=reading == "falls",
            rate_ul_s=own.drain_rate_ul_s,
            tolerance_ratio=own.tolerance_ratio,
            poll_s=own.poll_s,
            now_s=self.now_s,
        )
        with before_acting():
            self._refuse_unless_ready(run)
            self.pause(0)
        run.began_s = self.now_s()
        with self._closing(run):
            self._drain.open()
            run.is_taken = True
            self._await_boundary(run)
        return run.report()

    @action(timeout_s=60.0, recovery="R1")
    def close_drain(self) -> Report:
        """Close the drain, and return once its valve is read back at its zero.

        Raises:
            DeviceError: It is not shown to be closed; the drain may be open (UNKNOWN).

        Effect:
            Nothing runs out any more.
        """
        with once_started(self._drain.close, None, driver=self):
            self._drain.close()
            return Report(evidence={"is_drain_closed": True, "valve_count": self._drain.count()})

    @action(timeout_s=60.0, recovery="R3")
    def confirm_drain_closed(self) -> Report:
        """Take the drain for closed where its valve stands: a person has looked, and it is.

        Needed once after the driver or the motor began: no one else can tell.

        Raises:
            RejectedError: The motor of the valve is in alarm (NONE).
            DeviceError: It was not taken, or the motor does not hold; nobody knows (UNKNOWN).

        Effect:
            Nothing moves. The motor holds the valve, and its zero is here.
        """
        self._drain.confirm()
        return Report(evidence={"is_drain_closed": True, "valve_count": self._drain.count()})

    def _refuse_unless_ready(self, run: DrainRun) -> None:
        """Refuse to open the drain unless all stands and a settled lower phase is at the neck."""
        if speed_rpm := self.speed_rpm():
            raise RejectedError(f"the stirrer turns at {speed_rpm:g} rpm: it has to stand")
        self._drain.refuse_unless_closed()
        for _ in range(SETTLED_LOOKS):
            level = self._lower_phase(falls=run.falls)
            run.seen = {f"first_{name}": value for name, value in level.items()}
            self.pause(self.config.poll_s)
        make_ready(self._drain.motor)

    def _lower_phase(self, *, falls: bool) -> dict[str, Any]:
        """Return what is at the neck, which has to be a settled lower phase."""
        level = self._sensor.level()
        limit = self.config.high_count if falls else self.config.low_count
        is_lower = level.signal >= limit if falls else level.signal <= limit
        if not level.has_liquid or not is_lower:
            raise RejectedError(
                f"the signal at the neck is {level.signal}, liquid: {level.has_liquid}; a settled "
                f"lower phase gives at {'least' if falls else 'most'} {limit}: let it settle, or "
                "look what is there",
                code="device.not_settled",
                context=_seen(level),
            )
        return _seen(level)

    def _await_boundary(self, run: DrainRun) -> None:
        """Watch the open drain; return once the signal crosses, or it cannot agree any more.

        Air at the neck is no boundary: the upper phase has run out too, or there was none.
        """
        own = self.config
        while True:
            level = self._sensor.level()
            has_crossed = (level.signal <= own.threshold_count) is run.falls
            is_too_late = run.by_time_ul() > run.volume_ul + run.off_ul
            if has_crossed or is_too_late or not level.has_liquid:
                run.seen |= {"boundary": has_crossed and level.has_liquid, **_seen(level)}
                return
            self._drain.watch(run)
            self.pause(own.poll_s)

    @contextmanager
    def _closing(self, run: DrainRun) -> Iterator[None]:
        """Close the drain behind what is inside, whatever becomes of it."""
        failure = None
        try:
            yield
        except DeviceError as error:
            if isinstance(error, RejectedError) and not run.is_taken:
                raise  # by the manual nothing moved
            failure = error
        except BaseException:  # a mistake of the driver leaves no drain open
            with suppress(DeviceError):
                self._drain.close()
            raise
        run.seen["by_time_ul"] = run.by_time_ul()
        try:
            self._drain.close()
        except DeviceError as second:
            first = "" if failure is None else f"{failure.message}; "
            raise DeviceError(
                f"{first}the drain may be open: {second.message}: {LOOK}",
                code="device.drain_open",
                context={**run.seen, **second.context, "is_drain_closed": None},
            ) from (failure or second)
        run.seen["is_drain_closed"] = True
        if failure is not None:
            is_stop = isinstance(failure, DeviceStoppedError)
            failure.effect = Effect.PARTIAL if is_stop else Effect.UNKNOWN
            failure.context.update(run.seen)
            raise failure

    def _begin_to_turn(self, speed_rpm: int) -> None:
        own = self.config
        try:
            self._stirrer.turn(own.stirs, speed_rpm, own.acceleration_index)
        except RejectedError:
            raise  # by the manual nothing moved
        except DeviceError:
            with once_started(self._stop_stirrer, None, driver=self):
                raise

    def _turning(self) -> float:
        """Return the speed of a stirrer that has not stalled."""
        flags = self._stirrer.status()
        if flags & (HAS_STALLED | IS_PROTECTED) or not flags & IS_ENABLED:
            raise DeviceError(
                "the stirrer has stalled, or has let go: free it, and switch it off and on",
                code="device.alarm",
                context={"flags": flags},
            )
        return self.speed_rpm()

    def _stop_stirrer(self) -> None:
        """Stop the stirrer, and return once it stands."""
        with suppress(RejectedError):  # one that is not enabled takes no stop
            self._stirrer.stop()
        await_reading(
            self,
            self.speed_rpm,
            WantedReading(0.0, STANDING_RPM, "rpm"),
            limit_s=self.config.speed_limit_s,
            poll_s=self.config.poll_s,
            is_stopping=True,
        )

    def _speed(self) -> dict[str, Any]:
        return {"speed_rpm": self.speed_rpm()}


def _seen(level: LevelReading) -> dict[str, Any]:
    return {"neck_signal_count": level.signal, "has_liquid_at_neck": level.has_liquid}
