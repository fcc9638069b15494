"""Vacuubrand CVC 3000 vacuum controller.

Protocol: CVC 3000 lines, 19200 8N1 with RTS/CTS, CR LF, at most ten a second; setters echo.
Quality: bronze, simulated instrument.
Safe state: control and pump off, vent valve shut; on a lost link the controller goes on.

Connecting chooses the CVC 3000 command set and echoes. A wrong command then has no answer
at all. Pressures are set in whole mbar.

No accuracy is stated: of the pressure no figure of the maker was found.

Source:
    Vacuubrand, instructions for use of CVC 3000, section "RS 232", command tables.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.vacuum_controller import VacuumController
from drivers.transports.base import ByteTransport
from drivers.waiting import WantedReading, await_reading, await_true, once_started, refuse_beyond
from labweb.domain.errors import DeviceError, FrameError, RejectedError

END = b"\r\n"
MODEL = "CVC 3000"
MBAR_PER_KPA = 10.0
UNITS_AS_MBAR = {"mbar", "hPa"}

VACUUM_CONTROL = 2
VENT_SHUT, VENT_TO_ATMOSPHERE = 0, 2
MOTOR, VENT, CONTROL = 0, 3, 5
"""Digits of IN_STAT."""

FAULTS = (
    "pump",
    "in-line valve",
    "coolant valve",
    "vent valve",
    "overpressure",
    "vacuum sensor",
    "external fault",
    "catch pot full",
)
"""Digits of IN_ERR, the first one first; the last digit is about the command before."""

ANSWER_S = 1.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One controller."""

    min_pressure_kpa: Annotated[float, Range(0.0, 106.0)] = 0.0
    reach_limit_s: Annotated[float, Range(0.1, 7000.0)] = 3600.0
    """Longest time to reach a pressure."""

    vent_limit_s: Annotated[float, Range(0.1, 3000.0)] = 600.0
    """Longest time to vent."""

    atmosphere_kpa: Annotated[float, Range(50.0, 106.0)] = 85.0
    """Least pressure that counts as atmospheric after venting; lower it in the mountains."""

    settle_s: Annotated[float, Range(0.0, 600.0)] = 2.0
    """How long the reading must stay within tolerance."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 1.0
    gap_s: Annotated[float, Range(0.0, 5.0)] = 0.1
    """Least time between two commands."""


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("IN_PV_1")
        b'IN_PV_1\r\n'
    """
    return f"{command}\r\n".encode("ascii")


def decode_text(frame: bytes) -> str:
    r"""Read an answer as text.

    Raises:
        FrameError: Not printable.

    Example:
        >>> decode_text(b"CVC 3000 V 2.00\r\n")
        'CVC 3000 V 2.00'
    """
    if not re.fullmatch(rb"[\x20-\x7e]+\r\n", frame):
        raise FrameError("answer is no text", context={"frame": frame.hex()})
    return frame.decode("ascii").strip()


def decode_pressure(text: str) -> float:
    """Read a pressure, in kPa.

    Raises:
        FrameError: Not a pressure.
        RejectedError: The controller is set to another unit.

    Example:
        >>> decode_pressure("0123.4 mbar")
        12.34
    """
    match = re.fullmatch(r"([0-9]{1,5}(?:\.[0-9]{1,2})?) +([A-Za-z]+)", text)
    if match is None:
        raise FrameError(f"{text!r} is no pressure")
    if match[2] not in UNITS_AS_MBAR:
        raise RejectedError(
            f"the controller tells {match[2]}: set it to mbar or hPa", context={"unit": match[2]}
        )
    return round(float(match[1]) / MBAR_PER_KPA, 4)


def decode_digits(text: str, count: int) -> tuple[bool, ...]:
    """Read a row of digits, each of which is off at 0.

    Raises:
        FrameError: Not so many digits.

    Example:
        >>> decode_digits("100021", 6)
        (True, False, False, False, True, True)
    """
    if not re.fullmatch(rf"[0-9]{{{count}}}", text):
        raise FrameError(f"{text!r} is not {count} digits")
    return tuple(digit != "0" for digit in text)


class VacuubrandCvc3000(Driver[ByteTransport, Config], VacuumController):
    """One vacuum controller."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Choose the command set and echoes, and refuse another model; nothing moves."""
        self._choose_commands()
        name = self._ask("IN_VER")
        if not name.startswith(MODEL):
            raise RejectedError(
                f"{self.transport.line} answers as {name!r}, expected {MODEL!r}",
                context={"model": name},
            )

    def halt(self) -> None:
        """Turn the control off and shut the vent valve, also after a loss of power."""
        self._choose_commands()
        self._tell("REMOTE 1", 1)
        self._tell("STOP 1", 1)
        self._tell(f"OUT_VENT {VENT_SHUT}", VENT_SHUT)

    @status(every_s=2.0)
    def pressure_kpa(self) -> float:
        """Tell the reading, absolute."""
        return decode_pressure(self._ask("IN_PV_1"))

    @status(every_s=4.0)
    def pressure_setpoint_kpa(self) -> float:
        """Tell the wanted pressure, absolute."""
        return decode_pressure(self._ask("IN_SP_1"))

    @status(every_s=2.0)
    def is_pumping(self) -> bool:
        """Tell whether the pump runs."""
        return self._state()[MOTOR]

    @status(every_s=4.0)
    def is_controlling(self) -> bool:
        """Tell whether the control is on; its pump rests where the pressure is reached."""
        return self._state()[CONTROL]

    @action(timeout_s=7200.0, recovery="R1", hazards=("vacuum",))
    def evacuate_to(
        self,
        pressure_kpa: Annotated[float, Range(0.0, 106.0)],
        tolerance_kpa: Annotated[float, Range(0.05, 50.0)],
    ) -> Report:
        """Pump down, and return once the reading has stayed within tolerance.

        Raises:
            DeviceError: Not reached in time, a fault, or stopped: the pump is off again, and
                `context["pressure_kpa"]` says how far it came (PARTIAL).

        Effect:
            The controller keeps this pressure.
        """
        self.refuse_if_stopped()
        refuse_beyond("pressure", pressure_kpa, self.config.min_pressure_kpa, 106.0)
        with before_acting():
            self.pressure_kpa()
            self._refuse_fault()
        pressure_mbar = round(pressure_kpa * MBAR_PER_KPA)
        with once_started(self.halt, self._pressures, driver=self):
            self._tell("REMOTE 1", 1)
            self._tell(f"OUT_MODE {VACUUM_CONTROL}", VACUUM_CONTROL)
            self._tell(f"OUT_SP_1 {pressure_mbar}", pressure_mbar)
            self._tell("START 1", 1)
            await_reading(
                self,
                self._reading_under_control,
                WantedReading(pressure_kpa, tolerance_kpa, "kPa", self.config.settle_s),
                limit_s=self.config.reach_limit_s,
                poll_s=self.config.poll_s,
            )
            return Report(evidence=self._pressures())

    @action(timeout_s=30.0, recovery="R1")
    def stop_pump(self) -> Report:
        """End the control of the pressure; the vent valve stays shut.

        Effect:
            The pump is off; what is under vacuum stays so as long as it is tight.
        """
        with once_started(self.halt, self._pressures, driver=self):
            self.halt()
            return Report(evidence=self._pressures())

    @action(timeout_s=3600.0, recovery="R2", hazards=("gas_inlet",))
    def vent(self) -> Report:
        """Let gas in, and return once the controller has shut its valve at atmosphere.

        Raises:
            DeviceError: Not done in time, a fault, or stopped: the valve is shut again, and
                `context["pressure_kpa"]` says how far it came (PARTIAL).

        Effect:
            The control is off and what was evacuated is full of gas.
        """
        self.refuse_if_stopped()
        with before_acting():
            self.pressure_kpa()
        with once_started(self.halt, self._pressures, driver=self):
            self._tell("REMOTE 1", 1)
            self._tell("STOP 1", 1)
            self._tell(f"OUT_VENT {VENT_TO_ATMOSPHERE}", VENT_TO_ATMOSPHERE)
            await_true(
                self,
                self._is_vent_shut,
                "vent valve shut at atmosphere",
                limit_s=self.config.vent_limit_s,
                poll_s=self.config.poll_s,
            )
            if (reached_kpa := self.pressure_kpa()) < self.config.atmosphere_kpa:
                raise DeviceError(
                    f"the vent valve shut at {reached_kpa:g} kPa", code="device.not_reached"
                )
            return Report(evidence=self._pressures())

    def _choose_commands(self) -> None:
        """Choose the command set and echoes, which a loss of power undoes."""
        self._tell(MODEL, 3)  # the answer is the generation chosen, section "RS 232"
        self._tell("ECHO 1", 1)

    def _reading_under_control(self) -> float:
        self._refuse_fault()
        if not self._state()[CONTROL]:
            self.pause(0)  # a stop from another thread is told as such
            raise DeviceError("the control went off by itself", code="device.alarm")
        return self.pressure_kpa()

    def _is_vent_shut(self) -> bool:
        return not self._state()[VENT]

    def _state(self) -> tuple[bool, ...]:
        return decode_digits(self._ask("IN_STAT"), CONTROL + 1)

    def _refuse_fault(self) -> None:
        digits = decode_digits(self._ask("IN_ERR"), len(FAULTS) + 1)
        faults = [name for name, is_set in zip(FAULTS, digits, strict=False) if is_set]
        if faults:
            raise DeviceError(
                f"controller reports {', '.join(faults)}",
                code="device.alarm",
                context={"alarm": faults},
            )

    def _pressures(self) -> dict[str, Any]:
        return {
            "pressure_kpa": self.pressure_kpa(),
            "pressure_setpoint_kpa": self.pressure_setpoint_kpa(),
        }

    def _tell(self, command: str, expected: int) -> None:
        """Send a setter and make sure that its echo is the value."""
        match = re.match(r"[0-9]+", answer := self._ask(command))
        if match is None or int(match[0]) != expected:
            raise RejectedError(f"{command} was answered with {answer!r}")

    def _ask(self, command: str) -> str:
        frame = self.transport.exchange(
            encode_line(command), until=END, timeout_s=ANSWER_S, gap_s=self.config.gap_s
        )
        return decode_text(frame)
