"""Temperature controller that describes itself over OPC UA as a LADS device.

Protocol: OPC UA LADS 1.0, an AnalogControlFunction; security policy None, anonymous.
Quality: bronze, simulated instrument.
Safe state: control function stopped; on a lost link the function goes on.

Device, functional unit and function are named in the settings. What they have to have is looked
up under the names of the standard; unit and range are the server's own.

Source:
    OPC 30500-1 (LADS) 1.0, 7.2 LADSDeviceType, 7.4 AnalogControlFunctionType and 7.6
    ControlFunctionStateMachineType; numbers of nodes from its published node set.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import (
    Accuracy,
    Driver,
    Quantity,
    Range,
    Report,
    action,
    after_acting,
    before_acting,
    status,
)
from drivers.interfaces.temperature_controller import TemperatureController
from drivers.transports.opcua.nodes import Node, NodeName
from drivers.transports.opcua.transport import OpcUaTransport
from drivers.waiting import (
    TemperatureControl,
    once_started,
    refuse_beyond,
    refuse_untaken,
)
from labweb.domain.errors import DeviceError, FrameError, RejectedError

DI = "http://opcfoundation.org/UA/DI/"
LADS = "http://opcfoundation.org/UA/LADS/"
UA = "http://opcfoundation.org/UA/"
DEVICE_SET = "i=5001"  # OPC 10000-100, 5.9
STATES = {
    "nsu=http://opcfoundation.org/UA/LADS/;i=5085": "Stopped",
    "nsu=http://opcfoundation.org/UA/LADS/;i=5099": "Running",
    "nsu=http://opcfoundation.org/UA/LADS/;i=5100": "Stopping",
    "nsu=http://opcfoundation.org/UA/LADS/;i=5159": "Aborting",
    "nsu=http://opcfoundation.org/UA/LADS/;i=5160": "Aborted",
    "nsu=http://opcfoundation.org/UA/LADS/;i=5143": "Clearing",
}
"""FunctionalStateMachineType, by the nodes of its states."""

CELSIUS = "CEL"
RESOLUTION_C = 0.05

Temperature = Annotated[float, Range(-200.0, 1500.0), Accuracy()]
Tolerance = Annotated[float, Range(0.1, 50.0), Quantity("temperature_difference")]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One control function of a device."""

    device: str
    """Browse name of the device in the server's device set."""

    unit: str
    """Browse name of the functional unit."""

    function: str
    """Browse name of the control function."""

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


@dataclass(frozen=True, slots=True)
class Parts:
    """The nodes of the function."""

    reading: NodeName
    target: NodeName
    machine: NodeName
    state: NodeName
    start: NodeName
    stop: NodeName
    low_c: float
    high_c: float


class LadsController(Driver[OpcUaTransport, Config], TemperatureController):
    """One control function of a LADS device."""

    transport_type: ClassVar[type] = OpcUaTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config
    _found: Parts | None = None

    def identify(self) -> None:
        """Look the function up, and check its unit and range.

        Raises:
            DeviceError: Something that the standard asks for is missing, or it is not in °C.
        """
        self._found = self._look_up()

    def halt(self) -> None:
        """Stop the control function; nothing is sent where it does not run.

        Raises:
            RejectedError: It runs on.
        """
        with self.transport.lock:  # two that halt at once do not both call Stop
            if self._state() != "Running":
                return
            self.transport.call(self._parts.machine, self._parts.stop, what="Stop")
            with after_acting():
                if self._state() == "Running":
                    raise RejectedError("the function runs on after Stop")

    @status(every_s=2.0)
    def temperature_c(self) -> Annotated[float, Accuracy()]:
        """Tell the reading.

        Raises:
            DeviceError: The server calls the value bad or uncertain.
        """
        return self.transport.read_number(self._parts.reading, "CurrentValue")

    @status(every_s=4.0)
    def temperature_setpoint_c(self) -> float:
        """Tell the wanted temperature."""
        return self._target_c()

    @status(every_s=4.0)
    def is_controlling(self) -> bool:
        """Tell whether the function runs."""
        return self._state() == "Running"

    @action(timeout_s=43_200.0, recovery="R1", hazards=("heat", "cold"))
    def reach_temperature(self, temperature_c: Temperature, tolerance_c: Tolerance) -> Report:
        """Return once the reading has stayed within tolerance.

        Raises:
            PreconditionError: Beyond the limits of this lab or of the device (NONE).
            DeviceError: Not reached in time, a bad value, another state, or stopped: the
                function is stopped, and `context["temperature_c"]` says how far it came
                (PARTIAL); after a lost session or line UNKNOWN.

        Effect:
            The function runs on with this target.
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
                function is stopped, and `context["held_s"]` says after how long (PARTIAL).

        Effect:
            The function runs on with this target.
        """
        reading_c = self._check_start(temperature_c)
        return self._control.hold(reading_c, duration_s, temperature_c, tolerance_c)

    @action(timeout_s=30.0, recovery="R1")
    def stop_control(self) -> Report:
        """Stop the control function; what is hot cools by itself.

        Effect:
            No more heat or cold is asked for.
        """
        with once_started(self.halt, self._temperatures, driver=self):
            self.halt()
            return Report(evidence=self._temperatures())

    @property
    def _control(self) -> TemperatureControl:
        return TemperatureControl(
            driver=self,
            read=self._reading_under_control,
            begin=self._refuse_untaken,
            end=self.halt,
            describe=self._temperatures,
            before=self._start,
        )

    def _check_start(self, temperature_c: float) -> float:
        """Return the reading before anything is sent that acts."""
        self.refuse_if_stopped()
        low_c, high_c = self.config.min_temperature_c, self.config.max_temperature_c
        refuse_beyond("temperature", temperature_c, low_c, high_c)
        refuse_beyond("temperature", temperature_c, self._parts.low_c, self._parts.high_c)
        with before_acting():
            if (state := self._state()) not in {"Stopped", "Running"}:
                raise RejectedError(
                    f"the function is {state}: clear it at the device", context={"state": state}
                )
            return self.temperature_c()

    def _start(self, temperature_c: float) -> None:
        """Start with the target, or give a running function another one.

        Raises:
            RejectedError: The device refused, and goes on as before (NONE).
            DeviceError: Nobody knows whether it began; a stop was tried (UNKNOWN).
        """
        with before_acting():
            is_running = self._state() == "Running"
        try:
            self._ask_for(temperature_c, is_running=is_running)
        except RejectedError:
            raise
        except DeviceError:
            with once_started(self.halt, None, driver=self):
                raise

    def _ask_for(self, temperature_c: float, *, is_running: bool) -> None:
        parts = self._parts
        if is_running:
            self.transport.write(parts.target, temperature_c, "TargetValue")
        else:
            what = "StartWithTargetValue"
            self.transport.call(parts.machine, parts.start, temperature_c, what=what)

    def _refuse_untaken(self, temperature_c: float) -> None:
        taken_c = self._target_c()
        refuse_untaken("TargetValue", taken_c, temperature_c, resolution=RESOLUTION_C)

    def _reading_under_control(self) -> float:
        if (state := self._state()) != "Running":
            self.pause(0)  # a stop from another thread is told as such
            raise DeviceError(
                f"the function went to {state} by itself",
                code="device.alarm",
                context={"state": state},
            )
        return self.temperature_c()

    def _state(self) -> str:
        number = self.transport.read(self._parts.state, "CurrentState")
        if number not in STATES:
            raise FrameError(f"CurrentState is {number!r}, which is no state of the standard")
        return STATES[str(number)]

    def _target_c(self) -> float:
        return self.transport.read_number(self._parts.target, "TargetValue")

    def _temperatures(self) -> dict[str, Any]:
        return {
            "temperature_c": self.temperature_c(),
            "temperature_setpoint_c": self._target_c(),
        }

    @property
    def _parts(self) -> Parts:
        if self._found is None:
            self._found = self._look_up()
        return self._found

    def _look_up(self) -> Parts:
        device = self._child(NodeName(DI, DEVICE_SET), self.config.device)
        units = self._child(device.id, "FunctionalUnitSet", LADS)
        unit = self._child(units.id, self.config.unit)
        functions = self._child(unit.id, "FunctionSet", LADS)
        function = self._child(functions.id, self.config.function)
        target = self._child(function.id, "TargetValue", LADS)
        reading = self._child(function.id, "CurrentValue", LADS)
        machine = self._child(function.id, "ControlFunctionState", LADS)
        state = self._child(machine.id, "CurrentState", UA)
        low_c, high_c = self._range(target)
        self._range(reading)
        return Parts(
            reading=reading.id,
            target=target.id,
            machine=machine.id,
            state=self._child(state.id, "Id", UA).id,
            start=self._child(machine.id, "StartWithTargetValue", LADS).id,
            stop=self._child(machine.id, "Stop", LADS).id,
            low_c=low_c,
            high_c=high_c,
        )

    def _child(self, parent: NodeName, name: str, uri: str = "") -> Node:
        """Find the one child of that name; a maker's name may stand in any namespace."""
        children = self.transport.children(parent)
        found = [one for one in children if one.name == name and uri in {"", one.name_uri}]
        if len(found) != 1:
            raise RejectedError(
                f"{parent} has {len(found)} nodes named {name!r}; one is needed",
                context={"names": sorted(one.name for one in children)},
            )
        return found[0]

    def _range(self, node: Node) -> tuple[float, float]:
        told = self.transport.variable(node.id)
        code = "" if told.unit is None else told.unit.code
        if code != CELSIUS or told.low is None or told.high is None:
            raise RejectedError(
                f"{node.name} has the unit {code or 'none'} and the range {told.low} to "
                f"{told.high}; this driver needs {CELSIUS} (°C) and both ends of a range",
                context={"unit": code},
            )
        return told.low, told.high
