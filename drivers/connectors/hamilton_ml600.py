"""Hamilton Microlab 600 syringe pump with its valve.

Protocol: protocol 1/RNO+, 9600 7O1, address, command, R, CR; answers ACK or NAK, data, CR LF.
Quality: bronze, simulated instrument.
Safe state: plunger and valve stand where they are; the command buffer is empty.

The pump has no query for whether it found its zero, so the driver remembers that it had it found;
after a new start it has to be initialised again. Strokes are absolute moves in whole seconds per
full stroke, rounded up: never faster than asked, and the evidence has the rate that was used.

Source:
    Hamilton, Microlab 600 Advanced Programming Manual, sections "RNO+ commands" and "Status
    requests". In the answer to T1 a bit is 0 while its part is busy, as real instruments do it and
    opposite to the manual.
"""

from __future__ import annotations

import math
import re
from typing import Annotated, ClassVar, Literal

import msgspec

from drivers.base import (
    Accuracy,
    Driver,
    Range,
    Report,
    action,
    after_acting,
    before_acting,
    status,
)
from drivers.connectors._motion import (
    SteppedPlunger,
    refuse_port,
    refuse_rate,
    run_stroke,
    turn_valve,
    watch,
)
from drivers.interfaces.pump import Pump
from drivers.interfaces.valve import Valve
from drivers.transports.base import ByteTransport
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    RejectedError,
)

ANSWER = re.compile(rb"[\x06\x15][^\r]*\r")
"""A whole answer: from ACK or NAK to the CR; the LF after it is thrown away."""

STEPS_FULL_COUNT = 48_000
FASTEST_S, SLOWEST_S = 2, 3692
"""Seconds of a full stroke, argument of S."""

ANSWER_S, INITIALIZE_S = 1.0, 60.0
FIRMWARE = "NV01"
VALVE_BITS = {"": 0, "B": 0, "C": 2}
"""Bit of the valve in the answer to T1; the pump's is the next."""

Volume = Annotated[float, Range(0.001, 100_000.0), Accuracy()]
Rate = Annotated[float, Range(0.001, 100_000.0)]
Address = Literal["a", "b", "c", "d", "e", "f", "g", "h", "i", "j", "k", "l", "m", "n", "o", "p"]


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One syringe of one instrument on its chain."""

    syringe_ul: Annotated[float, Range(1.0, 50_000.0)]
    """Volume of a full stroke of 60 mm."""

    address: Address = "a"
    """Place in the chain; "a" is the first."""

    side: Literal["", "B", "C"] = ""
    """"" for a single syringe; of two, B is the left and C the right one."""

    ports_count: Annotated[int, Range(2, 8)] = 2
    """Positions of the valve by name."""


def encode_command(address: str, command: str) -> bytes:
    r"""Build the frame of a command that runs at once.

    Example:
        >>> encode_command("a", "M24000S10")
        b'aM24000S10R\r'
    """
    return f"{address}{command}R\r".encode("ascii")


def encode_request(address: str, request: str) -> bytes:
    r"""Build the frame of a request, which does not go through the command buffer.

    Example:
        >>> encode_request("a", "T1")
        b'aT1\r'
    """
    return f"{address}{request}\r".encode("ascii")


def decode_reply(frame: bytes) -> str:
    r"""Return the data of an answer.

    Raises:
        RejectedError: NAK: the instrument did not take the command.
        FrameError: Not an answer of this protocol.

    Example:
        >>> decode_reply(b"\x0624000\r")
        '24000'
    """
    match = re.search(rb"([\x06\x15])([\x20-\x7f]*)\r\Z", frame)
    if match is None:
        raise FrameError("answer is no ACK or NAK line", context={"frame": frame.hex()})
    if match[1] == b"\x15":
        raise RejectedError("the instrument does not take the command (NAK)")
    return match[2].decode("ascii")


class HamiltonMl600(Driver[ByteTransport, Config], Pump, Valve):
    """One syringe and its valve."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    _has_zero = False

    def connect(self) -> None:
        """Open the line and make sure that an ML600 answers; whether it has its zero is open."""
        self._has_zero = False
        super().connect()

    def identify(self) -> None:
        """Ask for the firmware; a chain that has no addresses yet is given them. Nothing moves."""
        try:
            firmware = self._ask("U")
        except DeviceTimeoutError:
            self.transport.exchange(b"1a\r", until=b"\r", timeout_s=ANSWER_S)
            firmware = self._ask("U")
        if not firmware.startswith(FIRMWARE):
            raise RejectedError(
                f"{self.config.address} has firmware {firmware!r}, expected {FIRMWARE}"
            )

    def halt(self) -> None:
        """Pause what moves, and empty the command buffer so that nothing goes on."""
        self._ask("K")
        self._ask("V")

    @status(every_s=2.0)
    def is_initialized(self) -> bool:
        """Tell whether this driver had the plunger's zero found since it started."""
        return self._has_zero

    @status(every_s=0.5)
    def volume_ul(self) -> Annotated[float, Accuracy()]:
        """Tell how much the syringe holds, from the plunger's position."""
        return self._plunger.volume_ul(self.position())

    @status(every_s=1.0)
    def port_index(self) -> int:
        """Tell the valve's position by name, counted from 1."""
        return self._number(f"{self.config.side}LQP")

    @action(timeout_s=90.0, recovery="R2", hazards=("expels_liquid",), operation="transfer")
    def initialize(self) -> Report:
        """Find the zero of plunger and valve.

        Effect:
            Whatever is in the syringe is pushed out through the valve's output.
            `moved_ul` is None when the zero was unknown before.
        """
        self.refuse_if_stopped()
        with before_acting():
            before = self.position() if self._has_zero else None
        self._has_zero = False
        self._act(f"{self.config.side}X")
        with after_acting():
            watch(self, self.is_idle, INITIALIZE_S)
            after = self.position()
        self._has_zero = True
        moved_ul = None if before is None else self._plunger.volume_ul(before - after)
        return Report(moved_ul, {"steps_before": before, "steps_after": after})

    @action(timeout_s=1860.0, recovery="R2", operation="transfer")
    def aspirate(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Draw liquid in through the selected port, and return once the plunger stands.

        Effect:
            `moved_ul`, the volume in whole steps, from the port into the syringe.
        """
        return self._stroke(volume_ul, rate_ul_s, 1)

    @action(timeout_s=1860.0, recovery="R2", operation="transfer")
    def dispense(self, volume_ul: Volume, rate_ul_s: Rate) -> Report:
        """Push liquid out through the selected port, and return once the plunger stands.

        Effect:
            `moved_ul`, the volume in whole steps, from the syringe out of the port.
        """
        return self._stroke(volume_ul, rate_ul_s, -1)

    @action(timeout_s=30.0, recovery="R1")
    def select_port(self, port_index: Annotated[int, Range(1, 8)]) -> Report:
        """Turn clockwise to a position by name, counted from 1, and return once it is reached.

        Effect:
            None on matter; what flows next flows through that port.
        """
        self.refuse_if_stopped()
        refuse_port(port_index, self.config.ports_count)
        return turn_valve(
            self,
            port_index,
            begin=lambda: self._act(f"{self.config.side}LP0{port_index}"),
            is_idle=self.is_idle,
            where=self.port_index,
        )

    def position(self) -> int:
        """Return the plunger's step."""
        return self._number(f"{self.config.side}YQP")

    def is_idle(self) -> bool:
        """Tell whether plunger and valve stand; an error of either is raised."""
        data = self._ask("T1")
        if len(data) != 1:
            raise FrameError(f"T1 was answered with {data!r}, not with one character")
        bits = ord(data) >> VALVE_BITS[self.config.side]
        if bits & 0b11 != 0b11:
            return False
        for request, part in (("Z", "syringe"), ("G", "valve")):
            if (answer := self._ask(f"{self.config.side}{request}")) != "N":
                raise DeviceError(
                    f"{part} error: {request} is answered with {answer!r}", effect=Effect.UNKNOWN
                )
        return True

    def knows_position(self) -> bool:
        """Tell whether the position can be trusted: only a stop from here is known to keep it."""
        return self._has_zero and self.is_stopped

    def _stroke(self, volume_ul: float, rate_ul_s: float, direction: int) -> Report:
        self.refuse_if_stopped()
        syringe_ul = self.config.syringe_ul
        refuse_rate(rate_ul_s, syringe_ul / SLOWEST_S, syringe_ul / FASTEST_S)
        seconds = math.ceil(round(syringe_ul / rate_ul_s, 6))
        try:
            report = run_stroke(
                self,
                self._plunger,
                self,
                steps=direction * self._plunger.steps(volume_ul),
                speed_steps_s=STEPS_FULL_COUNT / seconds,
                begin=lambda target: self._act(f"{self.config.side}M{target}S{seconds}"),
            )
        except DeviceError as error:
            if error.effect is Effect.UNKNOWN:
                self._has_zero = False
            raise
        report.evidence["rate_ul_s"] = round(syringe_ul / seconds, 6)
        return report

    def _act(self, command: str) -> None:
        frame = encode_command(self.config.address, command)
        decode_reply(self.transport.exchange(frame, until=ANSWER, timeout_s=ANSWER_S))

    def _ask(self, request: str) -> str:
        frame = encode_request(self.config.address, request)
        return decode_reply(self.transport.exchange(frame, until=ANSWER, timeout_s=ANSWER_S))

    def _number(self, request: str) -> int:
        data = self._ask(request)
        if not re.fullmatch(r"[0-9]{1,6}", data):
            raise FrameError(f"{request} was answered with {data!r}, not with a number")
        return int(data)

    @property
    def _plunger(self) -> SteppedPlunger:
        return SteppedPlunger(self.config.syringe_ul, STEPS_FULL_COUNT)
