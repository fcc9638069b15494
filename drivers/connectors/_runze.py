r"""The binary protocol of Runze pumps and valves: frames, status codes and waiting for the end.

Some units answer a move only once it is done, others answer at once that they are busy. Both are
listened to: the line is held until the first answer, and the motor's status is asked after it.

Source:
    Runze, SY-01 and SV-06 manuals, section "Communication protocol".
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, NamedTuple

from drivers.base import Driver
from drivers.transports.base import ByteTransport
from labweb.domain.errors import DeviceError, DeviceTimeoutError, Effect, FrameError, RejectedError

FRAME = re.compile(rb"\xcc.{7}", re.DOTALL)
"""A whole answer: STX and seven more bytes."""

START, END = 0xCC, 0xDD
ANSWER_S = 1.0
VALVE_POSITION, DISPENSE, ASPIRATE, VALVE_TO = 0x3E, 0x42, 0x43, 0x44
HOME, STOP, MOTOR_STATUS, PLUNGER_POSITION, ADDRESS = 0x45, 0x49, 0x4A, 0x66, 0x20

DONE, BUSY, UNKNOWN_POSITION, EXECUTING = 0x00, 0x04, 0x06, 0xFE
STATUSES = {
    0x01: "frame error",
    0x02: "parameter error",
    0x03: "optocoupler error",
    0x04: "motor busy",
    0x05: "motor stalled",
    0x06: "unknown position",
    0xFE: "task being executed",
    0xFF: "unknown error",
}
REFUSALS = frozenset({0x01, 0x02, 0x04})
"""Answers to a command after which, by the manual, it was not begun."""


class RunzeReply(NamedTuple):
    """A decoded answer."""

    status: int
    value: int


def encode_request(address: int, function: int, value: int = 0) -> bytes:
    """Build a request: the parameter and the sum go low byte first.

    Example:
        >>> encode_request(1, VALVE_TO, 3).hex(" ")
        'cc 01 44 03 00 dd f1 01'
    """
    low_high = value.to_bytes(2, "little")  # section "Communication protocol": two bytes
    body = bytes((START, address, function)) + low_high + bytes((END,))
    return body + sum(body).to_bytes(2, "little")  # section "Communication protocol": sum


def decode_reply(frame: bytes, address: int) -> RunzeReply:
    """Read an answer, and make sure that it is whole and from this unit.

    Raises:
        FrameError: Wrong sum, wrong form, or another address.
    """
    body, total = frame[-8:-2], int.from_bytes(frame[-2:], "little")
    if len(body) != 6 or (body[0], body[-1]) != (START, END) or sum(body) != total:
        raise FrameError("answer has a wrong form or sum", context={"frame": frame.hex()})
    if body[1] != address:
        raise FrameError(f"unit {body[1]} answers instead of {address}")
    return RunzeReply(body[2], int.from_bytes(body[3:5], "little"))


@dataclass(frozen=True, slots=True)
class RunzeUnit:
    """One pump or valve at one address, on behalf of its driver."""

    driver: Driver[ByteTransport, Any]
    address: int

    def identify(self) -> None:
        """Ask for the address: nothing moves.

        Raises:
            RejectedError: The unit tells another address than it answers at.
        """
        reply = self.exchange(ADDRESS)
        if reply.status != DONE or reply.value & 0xFF != self.address:
            raise RejectedError(
                f"unit {self.address} answers {describe(reply.status)}, address {reply.value}"
            )

    def halt(self) -> None:
        """Stop the motor where it is."""
        self.exchange(STOP)

    def ask(self, function: int) -> int:
        """Return a value.

        Raises:
            RejectedError: The unit has none to tell.
        """
        reply = self.exchange(function)
        if reply.status != DONE:
            raise RejectedError(
                f"unit {self.address} reports {describe(reply.status)}",
                context={"status": reply.status},
            )
        return reply.value

    def act(self, function: int, value: int, limit_s: float) -> None:
        """Begin a motion, and return once the unit has answered or somebody stops the device.

        Raises:
            RejectedError: Refused; by the manual nothing moved.
            DeviceError: Anything else that went wrong; UNKNOWN.
        """
        transport = self.driver.transport
        with transport.lock:
            transport.send(encode_request(self.address, function, value))
            try:
                frame = transport.receive(
                    until=FRAME, timeout_s=limit_s, unless=lambda: self.driver.is_stopped
                )
            except DeviceTimeoutError:
                if self.driver.is_stopped:
                    return
                raise
        reply = decode_reply(frame, self.address)
        if reply.status in REFUSALS:
            raise RejectedError(
                f"unit {self.address} refuses: {describe(reply.status)}",
                context={"status": reply.status},
            )
        if reply.status not in {DONE, EXECUTING}:
            self._fail(reply)

    def is_idle(self) -> bool:
        """Tell whether the motor stands; a failure of the motion is raised."""
        reply = self.exchange(MOTOR_STATUS)
        if reply.status not in {DONE, BUSY, EXECUTING}:
            self._fail(reply)
        return reply.status == DONE

    def exchange(self, function: int) -> RunzeReply:
        """Ask, and return status and value as they came."""
        request = encode_request(self.address, function)
        frame = self.driver.transport.exchange(request, until=FRAME, timeout_s=ANSWER_S)
        return decode_reply(frame, self.address)

    def _fail(self, reply: RunzeReply) -> None:
        raise DeviceError(
            f"unit {self.address} reports {describe(reply.status)}",
            effect=Effect.UNKNOWN,
            context={"status": reply.status},
        )


def describe(status: int) -> str:
    """Name a status code."""
    return STATUSES.get(status, f"status {status:#04x}")
