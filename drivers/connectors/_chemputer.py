r"""The network protocol of Chemputer pumps and valves: text with a NUL at its end.

A move is answered twice: `RESPOND: … SUCCESS` when it is accepted, `RESPOND: … DONE` when it is
finished. There is no command that stops one. A device whose firmware expects it stops by itself
when the datagram `reset_wdt` stays away: the address of one device of the network names where it
goes, `tcp://192.168.1.10:5000?beat=192.168.255.255:3000`.

Source:
    Cronin group, Chemputer pumps and valves, control software, table of commands; times from logs
    of real runs: a move takes its volume by its rate and 0.4 s, a valve 0.38 to 3.3 s.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Literal

from drivers.base import DeviceStoppedError, Driver
from drivers.transports.base import ByteTransport
from labweb.domain.errors import DeviceError, Effect, FrameError, RejectedError

ANSWER_S = 2.0
KEEP_ALIVE, KEEP_ALIVE_S = b"reset_wdt\0", 0.5
ENDED = re.compile(
    rb"SUCCESS[^\0]*\0(?:[^\0]*\0)*?[^\0]*(?:DONE|FAILURE|[Ss]tall)[^\0]*\0"
    rb"|FAILURE[^\0]*\0|[Ss]tall[^\0]*\0"
)
"""A move from its acceptance to its end, or its refusal."""

ERRORS = re.compile(rb"ERRORS: *(\d{1,5})[^\0]*\0")
CONFIG = re.compile(rb"(PUMP|VALVE)_CFG[^\0]*\0")
CLEARED = re.compile(rb"(?:SUCCESS|DONE|FAILURE)[^\0]*\0")


def encode_message(text: str) -> bytes:
    r"""Build the frame of a message.

    Example:
        >>> encode_message("pos 3")
        b'pos 3\x00'
    """
    return text.encode("ascii") + b"\0"


@dataclass(slots=True)
class ChemputerUnit:
    """One pump or valve at its address, on behalf of its driver."""

    driver: Driver[ByteTransport, Any]
    is_moving: bool = False

    def identify(self, wanted: Literal["PUMP", "VALVE"]) -> None:
        """Ask what answers, and clear the errors that a start leaves. Nothing moves.

        Raises:
            RejectedError: The other sort of device answers, or an error stays.
        """
        self.driver.transport.keep_alive(KEEP_ALIVE, KEEP_ALIVE_S)
        found = CONFIG.search(self._ask("read_config", CONFIG))
        if found is None or found[1].decode("ascii") != wanted:
            raise RejectedError(f"{self.driver.transport.line} is no {wanted.lower()}")
        if self.errors():
            self._ask("clear_errors", CLEARED)
        if errors := self.errors():
            raise RejectedError(
                f"errors {errors} stay after they were cleared", context={"errors": errors}
            )

    def errors(self) -> int:
        """Return the error bits, 0 for none."""
        found = ERRORS.search(self._ask("read_errors", ERRORS))
        return int(found[1]) if found is not None else 0

    def act(self, command: str, limit_s: float, done: dict[str, Any]) -> None:
        """Send a move and wait for its end.

        Args:
            command: The move.
            limit_s: Longest time that it may take.
            done: Context of the error when somebody stopped the device meanwhile.

        Raises:
            RejectedError: Refused; nothing moved.
            DeviceError: It failed on its way; UNKNOWN.
            DeviceStoppedError: It ran to its end all the same: PARTIAL, with `done`.
        """
        self.is_moving = True
        try:
            request = encode_message(command)
            answer = self.driver.transport.exchange(request, until=ENDED, timeout_s=limit_s)
        finally:
            self.is_moving = False
        if not answer.isascii():
            raise FrameError(f"{command} is not answered in text", context={"frame": answer.hex()})
        words = answer.rstrip(b"\0").decode("ascii").split("\0")
        if "DONE" not in words[-1]:
            if "FAILURE" in words[-1] and not any("SUCCESS" in word for word in words):
                raise RejectedError(f"{command}: {words[-1]!r}")
            raise DeviceError(f"{command}: {words[-1]!r}", effect=Effect.UNKNOWN)
        if self.driver.is_stopped:
            raise DeviceStoppedError(
                "stopped; the move ran to its end, since this device has no stop",
                effect=Effect.PARTIAL,
                context=done,
            )

    def halt(self) -> None:
        """Do nothing where nothing moves.

        Raises:
            DeviceError: A move runs, and there is no command to stop it.
        """
        if self.is_moving:
            raise DeviceError(
                "a move runs to its end: this device has no stop",
                code="device.cannot_stop",
                effect=Effect.UNKNOWN,
            )

    def _ask(self, command: str, until: re.Pattern[bytes]) -> bytes:
        frame = encode_message(command)
        answer = self.driver.transport.exchange(frame, until=until, timeout_s=ANSWER_S)
        if not answer.isascii():
            raise FrameError(f"{command} is not answered in text", context={"frame": answer.hex()})
        return answer
