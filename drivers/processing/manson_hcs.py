"""Manson HCS-3000 switching supply.

Protocol: Manson letters and digits, 9600 8N1, CR; each command is answered by OK, after its data.
Quality: bronze, simulated instrument.
Safe state: output off; on a lost link it goes on.

The voltage goes in steps of 0.1 V, the current in steps that depend on the model: what lies
between is refused. Turning on is the digit 0, turning off the digit 1. The supply cannot be
asked whether its output is on.

Source:
    Manson, HCS-3100, 3102, 3204, 3400 remote programming manual, command table.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.power_supply import PowerSupply
from drivers.transports.base import ByteTransport
from drivers.waiting import once_started, refuse_between_steps, refuse_beyond, refuse_untaken
from labweb.domain.errors import FrameError, RejectedError

END = b"OK\r"
ON, OFF = 0, 1
STEP_V = 0.1
STEP_MA = {"HCS-3102": 10.0, "HCS-3204": 100.0, "HCS-3400": 100.0}
HUNDREDTHS = 100.0
MA_PER_A = 1000.0
HIGHEST_STEPS = 999
"""Setpoints have three digits."""

ANSWER_S = 1.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One supply."""

    model: Literal["HCS-3102", "HCS-3204", "HCS-3400"]
    max_voltage_v: Annotated[float, Range(0.0, 60.0)]
    """Highest voltage that this lab allows."""

    max_current_ma: Annotated[float, Range(0.0, 40_000.0)]
    """Highest current that this lab allows."""

    settle_s: Annotated[float, Range(0.0, 30.0)] = 0.5
    """Time between turning on and measuring."""


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("VOLT018")
        b'VOLT018\r'
    """
    return f"{command}\r".encode("ascii")


def decode_data(frame: bytes) -> str:
    r"""Read what stands before the OK; "" when nothing does.

    Raises:
        FrameError: Not such an answer.

    Example:
        >>> decode_data(b"HCS-3102 \rOK\r")
        'HCS-3102'
    """
    match = re.fullmatch(rb"(?:([\x20-\x7e]+)\r)?OK\r", frame)
    if match is None:
        raise FrameError("answer does not end in OK", context={"frame": frame.hex()})
    return (match[1] or b"").decode("ascii").strip()


def decode_digits(frame: bytes, *counts: int) -> tuple[int, ...]:
    r"""Read data that is groups of so many digits.

    Raises:
        FrameError: Not such digits.

    Example:
        >>> decode_digits(b"018206900\rOK\r", 4, 4, 1)
        (182, 690, 0)
    """
    data = decode_data(frame)
    match = re.fullmatch("".join(f"([0-9]{{{count}}})" for count in counts), data)
    if match is None:
        raise FrameError(f"data is {data!r}, not the digits asked for")
    return tuple(int(group) for group in match.groups())


class MansonHcs(Driver[ByteTransport, Config], PowerSupply):
    """One supply."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the model, and refuse another one."""
        model = decode_data(self._exchange("GMOD"))
        if model != self.config.model:
            raise RejectedError(
                f"{self.transport.line} answers as {model!r}, expected {self.config.model!r}",
                context={"model": model},
            )

    def halt(self) -> None:
        """Turn the output off."""
        self._set(f"SOUT{OFF}")

    @status(every_s=1.0)
    def voltage_v(self) -> float:
        """Tell the voltage at the terminals."""
        return self._measured()[0] / HUNDREDTHS

    @status(every_s=1.0)
    def current_ma(self) -> float:
        """Tell the current that flows."""
        return self._measured()[1] / HUNDREDTHS * MA_PER_A

    @status(every_s=2.0)
    def voltage_setpoint_v(self) -> float:
        """Tell the wanted voltage."""
        return round(self._setpoints()[0] * STEP_V, 1)

    @status(every_s=2.0)
    def current_setpoint_ma(self) -> float:
        """Tell the limit of current."""
        return self._setpoints()[1] * STEP_MA[self.config.model]

    @action(timeout_s=60.0, recovery="R1", hazards=("electricity",))
    def supply(
        self,
        voltage_v: Annotated[float, Range(0.0, 60.0)],
        current_ma: Annotated[float, Range(0.0, 40_000.0)],
    ) -> Report:
        """Turn the output on with a voltage and a limit of current, and measure both.

        Raises:
            PreconditionError: Beyond the limits of this lab, or between two steps (NONE).
            DeviceError: A setpoint was not taken, or stopped: the output is off again
                (PARTIAL).

        Effect:
            The output stays on with these setpoints.
        """
        self.refuse_if_stopped()
        step_ma = STEP_MA[self.config.model]
        most_v = min(self.config.max_voltage_v, HIGHEST_STEPS * STEP_V)
        most_ma = min(self.config.max_current_ma, HIGHEST_STEPS * step_ma)
        refuse_beyond("voltage", voltage_v, 0.0, most_v)
        refuse_beyond("current", current_ma, 0.0, most_ma)
        voltage_steps = refuse_between_steps("voltage", voltage_v, STEP_V)
        current_steps = refuse_between_steps("current", current_ma, step_ma)
        with before_acting():
            self._measured()
        with once_started(self.halt, self._evidence, driver=self):
            self._set(f"VOLT{voltage_steps:03d}")
            self._set(f"CURR{current_steps:03d}")
            taken_v, taken_ma = self.voltage_setpoint_v(), self.current_setpoint_ma()
            refuse_untaken("voltage", taken_v, voltage_v, resolution=STEP_V / 2)
            refuse_untaken("current", taken_ma, current_ma, resolution=step_ma / 2)
            self._set(f"SOUT{ON}")
            self.pause(self.config.settle_s)
            keeps = "current" if self._measured()[2] else "voltage"
            return Report(evidence={**self._evidence(), "keeps": keeps})

    @action(timeout_s=30.0, recovery="R1")
    def stop_supply(self) -> Report:
        """Turn the output off.

        Effect:
            No current flows.
        """
        with once_started(self.halt, self._evidence, driver=self):
            self.halt()
            return Report(evidence=self._evidence())

    def _measured(self) -> tuple[int, ...]:
        return decode_digits(self._exchange("GETD"), 4, 4, 1)

    def _setpoints(self) -> tuple[int, ...]:
        return decode_digits(self._exchange("GETS"), 3, 3)

    def _evidence(self) -> dict[str, Any]:
        return {"voltage_v": self.voltage_v(), "current_ma": self.current_ma()}

    def _set(self, command: str) -> None:
        if data := decode_data(self._exchange(command)):
            raise RejectedError(f"{command} was answered with {data!r}")

    def _exchange(self, command: str) -> bytes:
        return self.transport.exchange(encode_line(command), until=END, timeout_s=ANSWER_S)
