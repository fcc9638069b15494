"""The text protocol of Knauer's Azura valves.

Source:
    Knauer, Azura V 2.1S valve drive, section "Ethernet commands".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from drivers.base import Driver
from drivers.transports.base import ByteTransport
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError

END = b"\r\n"
ANSWER_S = 1.0
NOT_UNDERSTOOD = "?"
REFUSED = "E0"
FAULTS = {
    "E1": "motor current too high",
    "E2": "turned too slowly",
    "E3": "DIP switch fault",
    "E4": "homing failed",
    "E5": "DIP switch fault",
    "E6": "memory fault",
}


def encode_line(message: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("P")
        b'P\r\n'
    """
    return f"{message}\r\n".encode("ascii")


def decode_line(frame: bytes) -> str:
    """Return the text of an answer.

    Raises:
        RejectedError: Not understood, or refused: nothing was turned.
        DeviceError: The drive reports a fault; UNKNOWN.
        FrameError: Not text.
    """
    text = frame.removesuffix(END)
    if not text or not text.isascii() or not text.decode("ascii").isprintable():
        raise FrameError("answer is no line of text", context={"frame": frame.hex()})
    answer = text.decode("ascii").strip()
    if answer == NOT_UNDERSTOOD:
        raise RejectedError("the valve does not understand the command")
    if answer == REFUSED:
        raise RejectedError("the valve refuses the command (E0)")
    if answer in FAULTS:
        raise DeviceError(f"the valve reports {answer}: {FAULTS[answer]}", effect=Effect.UNKNOWN)
    return answer


@dataclass(frozen=True, slots=True)
class KnauerDrive:
    """One valve drive, on behalf of its driver."""

    driver: Driver[ByteTransport, Any]

    def identify(self, wanted: str) -> None:
        """Ask for the type of valve, and refuse another one. Nothing moves."""
        if (answer := self.ask("T")) != f"VALVE {wanted}":
            raise RejectedError(f"{answer!r} answers, expected 'VALVE {wanted}'")

    def position(self) -> str:
        """Return the position as the drive tells it."""
        return self.ask("P")

    def go(self, position: int | str) -> None:
        """Begin to turn; the drive echoes the position.

        Raises:
            FrameError: Another echo; UNKNOWN.
        """
        if (echo := self.ask(str(position))) != str(position):
            raise FrameError(f"{position} was echoed as {echo!r}")

    def ask(self, message: str) -> str:
        """Return the answer to a message."""
        frame = encode_line(message)
        return decode_line(self.driver.transport.exchange(frame, until=END, timeout_s=ANSWER_S))
