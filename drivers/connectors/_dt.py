"""The DT protocol of Tricontinent and Runze syringe pumps: frames, errors and what they share.

Source:
    Tricontinent, C-Series Product Manual, section "Data Terminal (DT) protocol"; Runze, SY-03B
    manual, section "DT communication protocol".
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, NamedTuple, NoReturn

from drivers.base import Driver, Report, after_acting, before_acting
from drivers.connectors._motion import (
    SteppedPlunger,
    refuse_port,
    refuse_rate,
    run_stroke,
    turn_valve,
    watch,
)
from drivers.transports.base import ByteTransport
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError

END = b"\x03\r\n"
IDLE_BIT = 0x20  # status byte, bit 5: 1 idle, 0 busy
ERROR_MASK = 0x0F  # status byte, low nibble: error code
ANSWER_S, INITIALIZE_S = 1.0, 60.0
FASTEST_STEPS_S = 6000
"""Highest argument of V in mode N0."""

ERRORS = {
    1: "initialisation failed",
    2: "invalid command",
    3: "invalid operand",
    4: "bad checksum in the command",
    6: "EEPROM failure",
    7: "not initialised",
    8: "internal bus failure",
    9: "plunger overload",
    10: "valve overload",
    11: "plunger may not move with the valve in bypass",
    15: "command overflow",
}
REFUSALS = frozenset({2, 3, 4, 7, 11, 15})
"""Codes after which, by the manual, nothing has moved."""


class DtReply(NamedTuple):
    """A decoded answer."""

    is_idle: bool
    error_code: int
    data: str


def encode_command(address: str, commands: str) -> bytes:
    r"""Build the frame of commands that act.

    Example:
        >>> encode_command("1", "V300A600")
        b'/1V300A600R\r'
    """
    return f"/{address}{commands}R\r".encode("ascii")


def encode_query(address: str, query: str) -> bytes:
    r"""Build the frame of a query, which needs no run command.

    Example:
        >>> encode_query("1", "?19")
        b'/1?19\r'
    """
    return f"/{address}{query}\r".encode("ascii")


def decode_reply(frame: bytes) -> DtReply:
    r"""Read an answer; line noise before its start is skipped.

    Raises:
        FrameError: Not an answer of this protocol.

    Example:
        >>> decode_reply(b"/0`1500\x03\r\n")
        Reply(is_idle=True, error_code=0, data='1500')
    """
    match = re.search(rb"/0([\x40-\x7f])([\x20-\x7e]*)\x03\r\n\Z", frame)
    if match is None:
        raise FrameError("answer is not in DT form", context={"frame": frame.hex()})
    status_byte = match[1][0]
    return DtReply(bool(status_byte & IDLE_BIT), status_byte & ERROR_MASK, match[2].decode("ascii"))


@dataclass(frozen=True, slots=True)
class DtPump:
    """One pump and its distribution valve, on behalf of its driver."""

    driver: Driver[ByteTransport, Any]
    address: str
    plunger: SteppedPlunger

    def identify(self, firmware: str) -> None:
        """Ask for status, initialised flag and firmware. Nothing moves.

        Raises:
            RejectedError: The firmware's answer does not contain what was expected.
        """
        reply = self._ask("Q")
        if reply.error_code not in REFUSALS | {0}:
            self._fail(reply.error_code, "connect")
        self.knows_position()
        found = self._ask("?23").data
        if not found or firmware not in found:
            raise RejectedError(
                f"pump {self.address} has firmware {found!r}, expected {firmware!r}"
            )

    def halt(self) -> None:
        """Terminate plunger and valve moves."""
        frame = encode_command(self.address, "T")
        decode_reply(self.driver.transport.exchange(frame, until=END, timeout_s=ANSWER_S))

    def position(self) -> int:
        """Return the plunger's step."""
        return self._number("?")

    def port_index(self) -> int:
        """Return the selected port."""
        return self._number("?6")

    def knows_position(self) -> bool:
        """Tell whether the plunger's zero is known."""
        data = self._ask("?19").data
        if data not in {"0", "1"}:
            raise FrameError(f"initialised flag is {data!r}", effect=Effect.NONE)
        return data == "1"

    def is_idle(self) -> bool:
        """Tell whether nothing moves; an error that came with the motion is raised."""
        reply = self._ask("Q")
        if reply.is_idle and reply.error_code:
            self._fail(reply.error_code, "move", effect=Effect.UNKNOWN)
        return reply.is_idle

    def initialize(self, command: str) -> Report:
        """Find the zero, and tell what was pushed out when the zero was known before."""
        self.driver.refuse_if_stopped()
        with before_acting():
            before = self.position() if self.knows_position() else None
        self._act(command)
        with after_acting():
            watch(self.driver, self.is_idle, INITIALIZE_S)
            if not self.knows_position():
                raise DeviceError("pump is idle after initialising, yet not initialised")
            after = self.position()
        moved_ul = None if before is None else self.plunger.volume_ul(before - after)
        return Report(moved_ul, {"steps_before": before, "steps_after": after})

    def stroke(
        self, volume_ul: float, rate_ul_s: float, max_rate_ul_s: float | None, direction: int
    ) -> Report:
        """Make a stroke as an absolute move, 1 to draw in and -1 to push out."""
        self.driver.refuse_if_stopped()
        per_step = self.plunger.ul_per_step
        fastest_ul_s = FASTEST_STEPS_S * per_step
        refuse_rate(rate_ul_s, per_step, min(fastest_ul_s, max_rate_ul_s or fastest_ul_s))
        speed = round(rate_ul_s / per_step)
        return run_stroke(
            self.driver,
            self.plunger,
            self,
            steps=direction * self.plunger.steps(volume_ul),
            speed_steps_s=speed,
            begin=lambda target: self._act(f"V{speed}A{target}"),
        )

    def select_port(self, port_index: int, ports_count: int) -> Report:
        """Turn the valve by command I, and prove where it stands."""
        self.driver.refuse_if_stopped()
        refuse_port(port_index, ports_count)
        return turn_valve(
            self.driver,
            port_index,
            begin=lambda: self._act(f"I{port_index}"),
            is_idle=self.is_idle,
            where=self.port_index,
        )

    def _act(self, commands: str) -> None:
        """Send a command that moves something; refusals by the manual have effect NONE."""
        frame = encode_command(self.address, commands)
        reply = decode_reply(self.driver.transport.exchange(frame, until=END, timeout_s=ANSWER_S))
        if reply.error_code:
            self._fail(reply.error_code, commands)

    def _fail(self, code: int, asked: str, *, effect: Effect | None = None) -> NoReturn:
        name = ERRORS.get(code, f"error {code}")
        message = f"{asked}: pump {self.address} reports {name}"
        if code in REFUSALS and effect is None:
            raise RejectedError(message, context={"error_code": code})
        raise DeviceError(message, effect=Effect.UNKNOWN, context={"error_code": code})

    def _ask(self, query: str) -> DtReply:
        frame = encode_query(self.address, query)
        return decode_reply(self.driver.transport.exchange(frame, until=END, timeout_s=ANSWER_S))

    def _number(self, query: str) -> int:
        data = self._ask(query).data
        if not re.fullmatch(r"[0-9]{1,6}", data):
            raise FrameError(f"{query} was answered with {data!r}, not with a number")
        return int(data)
