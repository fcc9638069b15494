"""Temperature controller that describes itself over SiLA 2.

Protocol: SiLA 2, the feature org.silastandard/examples/TemperatureController/v1.
Quality: bronze, simulated instrument.
Safe state: target at the rest temperature that is set; on a lost link the controller goes on.

The feature has no command that ends control: to stop is to ask for the rest temperature. Its range
is that of the server's own definition.

Source:
    SiLA 2, published feature definition TemperatureController 1.0: ControlTemperature with
    TargetTemperature in K, CurrentTemperature in K, TemperatureNotReachable, ControlInterrupted.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Accuracy, Driver, Quantity, Range, Report, action, before_acting, status
from drivers.interfaces.temperature_controller import TemperatureController
from drivers.transports.sila.features import Feature, Value
from drivers.transports.sila.transport import SilaTransport
from drivers.waiting import TemperatureControl, once_started, refuse_beyond
from labweb.domain.errors import DeviceError, RejectedError

FEATURE = "org.silastandard/examples/TemperatureController/v1"
CONTROL, TARGET, READING = "ControlTemperature", "TargetTemperature", "CurrentTemperature"
ZERO_C_K = 273.15
KELVIN = "Kelvin"

Temperature = Annotated[float, Range(-200.0, 1500.0), Accuracy()]
Tolerance = Annotated[float, Range(0.1, 50.0), Quantity("temperature_difference")]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One controller."""

    rest_temperature_c: Temperature
    """What it is asked for when it is stopped: a temperature that does no harm."""

    min_temperature_c: Temperature = -200.0
    max_temperature_c: Temperature
    """Highest temperature that this lab allows."""

    reach_limit_s: Annotated[float, Range(0.1, 42_000.0)] = 14_000.0
    """Longest time to reach a temperature."""

    settle_s: Annotated[float, Range(0.0, 600.0)] = 5.0
    """How long the reading must stay within tolerance."""

    grace_s: Annotated[float, Range(0.0, 600.0)] = 30.0
    """How long a held temperature may leave its tolerance."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 1.0


class SilaTemperatureController(Driver[SilaTransport, Config], TemperatureController):
    """One controller."""

    transport_type: ClassVar[type] = SilaTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config
    _number: str = ""
    """Of the execution that was begun last."""

    def identify(self) -> None:
        """Read the feature's definition, and check its unit, its range and the rest temperature.

        Raises:
            RejectedError: There is no such feature, it has other parts or units, or the rest
                temperature is beyond its range.
        """
        low_c, high_c = self._limits
        rest_c = self.config.rest_temperature_c
        if not low_c <= rest_c <= high_c:
            raise RejectedError(
                f"the rest temperature is {rest_c:g} °C, and the controller takes {low_c:g} to "
                f"{high_c:g} °C",
                context={"limits": [low_c, high_c]},
            )

    def halt(self) -> None:
        """Ask for the rest temperature."""
        self._begin(self.config.rest_temperature_c)

    @status(every_s=2.0)
    def temperature_c(self) -> Annotated[float, Accuracy()]:
        """Tell the reading."""
        return round(self.transport.read_number(self._feature, READING) - ZERO_C_K, 6)

    @action(timeout_s=43_200.0, recovery="R1", hazards=("heat", "cold"))
    def reach_temperature(self, temperature_c: Temperature, tolerance_c: Tolerance) -> Report:
        """Return once the reading has stayed within tolerance.

        Raises:
            PreconditionError: Beyond the limits of this lab or of the controller (NONE).
            DeviceError: Not reached in time, given up by the controller, or stopped: it rests,
                and `context["temperature_c"]` says how far it came (PARTIAL); after a lost line
                UNKNOWN.

        Effect:
            The controller goes on with this target.
        """
        self._check_start(temperature_c)
        return self._control.reach(temperature_c, tolerance_c)

    @action(timeout_s=604_800.0, recovery="R3", hazards=("heat", "cold"))
    def hold(
        self,
        duration_s: Annotated[float, Range(0.0, 600_000.0)],
        temperature_c: Temperature,
        tolerance_c: Tolerance,
    ) -> Report:
        """Keep a temperature that is already reached for a while, and watch it.

        After a crash nobody can tell how long it was kept: a person decides.

        Raises:
            PreconditionError: The reading is not within tolerance at the start (NONE).
            DeviceError: It left the tolerance for longer than the grace time, or stopped: the
                controller rests, and `context["held_s"]` says after how long (PARTIAL).

        Effect:
            The controller goes on with this target.
        """
        reading_c = self._check_start(temperature_c)
        return self._control.hold(reading_c, duration_s, temperature_c, tolerance_c)

    @action(timeout_s=30.0, recovery="R1")
    def stop_control(self) -> Report:
        """Ask for the rest temperature; what is hot cools by itself.

        Effect:
            The target is the rest temperature.
        """
        with once_started(self.halt, self._temperatures, driver=self):
            self.halt()
            return Report(evidence=self._temperatures())

    @property
    def _control(self) -> TemperatureControl:
        return TemperatureControl(
            driver=self,
            read=self._reading_under_control,
            before=self._start,
            begin=lambda _: None,
            end=self.halt,
            describe=self._temperatures,
        )

    def _check_start(self, temperature_c: float) -> float:
        """Return the reading before anything is sent that acts."""
        self.refuse_if_stopped()
        low_c, high_c = self.config.min_temperature_c, self.config.max_temperature_c
        refuse_beyond("temperature", temperature_c, low_c, high_c)
        with before_acting():
            refuse_beyond("temperature", temperature_c, *self._limits)
            return self.temperature_c()

    def _start(self, temperature_c: float) -> None:
        """Begin the command.

        Raises:
            RejectedError: The controller refused, and goes on as before (NONE).
            DeviceError: Nobody knows whether it began; the rest temperature was asked for.
        """
        try:
            self._begin(temperature_c)
        except RejectedError:
            raise
        except DeviceError:
            with once_started(self.halt, None, driver=self):
                raise

    def _begin(self, temperature_c: float) -> None:
        arguments = {TARGET: temperature_c + ZERO_C_K}
        self._number = self.transport.begin(self._feature, CONTROL, arguments)

    def _reading_under_control(self) -> float:
        """Return the reading, unless the controller has given up.

        A command that succeeded is over, and the controller goes on keeping its target.
        """
        number = self._number
        if self.transport.progress(self._feature, CONTROL, number) == "failed":
            self.pause(0)  # a stop from another thread is told as such
            self.transport.result(self._feature, CONTROL, number)
            raise DeviceError("the controller gave up", code="device.alarm")
        return self.temperature_c()

    def _temperatures(self) -> dict[str, Any]:
        return {"temperature_c": self.temperature_c()}

    @property
    def _feature(self) -> Feature:
        feature = self.transport.feature(FEATURE)
        command, reading = feature.commands.get(CONTROL), feature.properties.get(READING)
        if (
            command is None
            or reading is None
            or not command.is_observable
            or [one.name for one in command.parameters] != [TARGET]
            or not all(_is_in_kelvin(one) for one in (command.parameters[0], reading.value))
        ):
            raise RejectedError(f"{FEATURE} of this server has other parts or units")
        return feature

    @property
    def _limits(self) -> tuple[float, float]:
        """Return the range of the target.

        Raises:
            RejectedError: The definition leaves an end open.
        """
        target = self._feature.commands[CONTROL].parameters[0]
        if target.low is None or target.high is None:
            raise RejectedError(f"{TARGET} of this server has no range")
        return target.low - ZERO_C_K, target.high - ZERO_C_K


def _is_in_kelvin(value: Value) -> bool:
    """Tell whether a number is a temperature in K.

    The published definition has the exponent 0 where 1 is meant; both are taken.
    """
    unit = value.unit
    return (
        value.basic == "Real"
        and unit is not None
        and (unit.factor, unit.offset) == (1.0, 0.0)
        and unit.components in {((KELVIN, 0),), ((KELVIN, 1),)}
    )
