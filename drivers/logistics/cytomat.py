"""Thermo Cytomat C6000 store of plates.

Protocol: Cytomat lines, 9600 8N1, CR LF; a command is answered by ok or er and two digits.
Quality: bronze, simulated instrument.
Safe state: the handler ends the move that it has begun; there is no command that stops it.

The overview register tells when a move is over. A plate may be anywhere after a move that
failed, so its outcome is unknown and a person looks.

No accuracy is stated: of the climate's temperature no figure of the maker was found.

Source:
    Thermo Scientific, Cytomat automation manual, tables of commands, errors and registers.
"""

from __future__ import annotations

import re
from typing import Annotated, ClassVar

import msgspec

from drivers.base import Driver, Range, Report, action, before_acting, status
from drivers.interfaces.storage import Storage
from drivers.transports.base import ByteTransport
from drivers.waiting import await_true, once_started, refuse_beyond
from labweb.domain.errors import DeviceError, FrameError, RejectedError

END = b"\r\n"
OCCUPIED, HANDLER_OCCUPIED, ERROR, READY, BUSY = 0x80, 0x10, 0x08, 0x02, 0x01
"""Bits of the overview register."""

REFUSALS = {
    "01": "it is busy",
    "02": "it does not know the command",
    "03": "the telegram has another structure",
    "04": "a parameter is wrong",
    "05": "there is no such place",
    "11": "the handler is at another place",
    "12": "the shovel is out",
    "21": "the handler is full",
    "22": "the handler is empty",
    "31": "the transfer station is empty",
    "32": "the transfer station is full",
    "33": "the transfer station is not in place",
    "41": "the door is not configured",
    "42": "the door is not open",
    "51": "its memory failed",
    "52": "it wants a password",
}
"""Why a command is not begun; by the manual nothing has moved."""

ANSWER_S = 2.0


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One store."""

    slots_count: Annotated[int, Range(1, 999)]
    """Places that it has."""

    move_limit_s: Annotated[float, Range(0.1, 250.0)] = 120.0
    """Longest time for one move of a plate."""

    initialize_limit_s: Annotated[float, Range(0.1, 550.0)] = 300.0
    poll_s: Annotated[float, Range(0.005, 10.0)] = 1.0


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("mv:ts 001")
        b'mv:ts 001\r\n'
    """
    return f"{command}\r\n".encode("ascii")


def decode_register(frame: bytes, name: str) -> int:
    r"""Read a register of two hexadecimal digits.

    Raises:
        RejectedError: The store refused; nothing has moved.
        FrameError: Not an answer of this name.

    Example:
        >>> decode_register(b"bs 82\r\n", "bs")
        130
    """
    match = re.fullmatch(rb"([a-z]{2}) ([0-9A-Fa-f]{2})\r\n", frame)
    if match is None:
        raise FrameError(f"no answer to {name}", context={"frame": frame.hex()})
    word, digits = match[1].decode("ascii"), match[2].decode("ascii")
    if word == "er":
        reason = REFUSALS.get(digits, "of an unknown reason")
        raise RejectedError(f"the store refused: {reason}", context={"answer": digits})
    if word != name:
        raise FrameError(f"answer is {word}, not {name}", context={"frame": frame.hex()})
    return int(digits, 16)


class Cytomat(Driver[ByteTransport, Config], Storage):
    """One store of plates."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the overview, which only such a store has."""
        self._overview()

    def halt(self) -> None:
        """Nothing to send: the handler ends its move by itself."""

    @status(every_s=2.0)
    def is_ready(self) -> bool:
        """Tell whether the handler is initialised and has nothing to do."""
        overview = self._overview()
        return bool(overview & READY) and not overview & (BUSY | ERROR)

    @status(every_s=2.0)
    def has_plate_at_transfer(self) -> bool:
        """Tell whether the transfer station is occupied."""
        return bool(self._overview() & OCCUPIED)

    @status(every_s=10.0)
    def temperature_c(self) -> float:
        """Tell the temperature of the chamber."""
        frame = self._exchange("ch:it")
        match = re.fullmatch(rb"it [+-][0-9]{1,3}\.[0-9] ([+-][0-9]{1,3}\.[0-9])\r\n", frame)
        if match is None:
            raise FrameError("answer to ch:it is no temperature", context={"frame": frame.hex()})
        return float(match[1])

    @action(timeout_s=600.0, recovery="R3", hazards=("moving_parts",))
    def initialize(self) -> Report:
        """Find the zero of the handler, which must not carry a plate.

        Effect:
            The handler moves to its waiting place.
        """
        self.refuse_if_stopped()
        with before_acting():
            if self._overview() & HANDLER_OCCUPIED:
                raise RejectedError("the handler carries a plate: take it off first")
        self._move("ll:in", self.config.initialize_limit_s)
        with once_started(self.halt, None, driver=self):
            if not self.is_ready():
                raise DeviceError("the store is not ready after initialising")
        return Report()

    @action(timeout_s=300.0, recovery="R3", hazards=("moving_parts",))
    def store_plate(self, slot_index: Annotated[int, Range(1, 999)]) -> Report:
        """Take the plate from the transfer station to a place, counted from 1.

        Raises:
            RejectedError: No plate is there, the place is full, or the store is not ready;
                nothing has moved (NONE).
            DeviceError: The move failed: nobody knows where the plate is (UNKNOWN).

        Effect:
            The plate has moved from the transfer station to the place.
        """
        return self._carry("mv:ts", slot_index, is_storing=True)

    @action(timeout_s=300.0, recovery="R3", hazards=("moving_parts",))
    def retrieve_plate(self, slot_index: Annotated[int, Range(1, 999)]) -> Report:
        """Bring the plate from a place, counted from 1, to the transfer station.

        Raises:
            RejectedError: The transfer station is full, the place is empty, or the store is
                not ready; nothing has moved (NONE).
            DeviceError: The move failed: nobody knows where the plate is (UNKNOWN).

        Effect:
            The plate has moved from the place to the transfer station.
        """
        return self._carry("mv:st", slot_index, is_storing=False)

    def _carry(self, command: str, slot_index: int, *, is_storing: bool) -> Report:
        self.refuse_if_stopped()
        refuse_beyond("slot", slot_index, 1, self.config.slots_count)
        with before_acting():
            self._refuse_unless_ready()
            if self.has_plate_at_transfer() != is_storing:
                state = "empty" if is_storing else "full"
                raise RejectedError(f"the transfer station is {state}")
        self._move(f"{command} {slot_index:03d}", self.config.move_limit_s)
        with once_started(self.halt, None, driver=self):
            if self.has_plate_at_transfer() == is_storing:
                raise DeviceError(
                    f"the transfer station is as before after {command} {slot_index}",
                    code="device.not_reached",
                )
        return Report(evidence={"slot_index": slot_index})

    def _refuse_unless_ready(self) -> None:
        overview = self._overview()
        if overview & BUSY:
            raise RejectedError("the store is busy", context={"overview": overview})
        if overview & ERROR or not overview & READY:
            raise RejectedError(
                "the store reports an error, or was not initialised: initialise it",
                context={"overview": overview, "error": self._register("be")},
            )

    def _move(self, command: str, limit_s: float) -> None:
        decode_register(self._exchange(command), "ok")
        with once_started(self.halt, None, driver=self):
            await_true(self, self._has_ended, command, limit_s=limit_s, poll_s=self.config.poll_s)

    def _has_ended(self) -> bool:
        overview = self._overview()
        if overview & ERROR:
            error = self._register("be")
            raise DeviceError(
                f"the store reports error {error:02X}",
                code="device.alarm",
                context={"alarm": f"{error:02X}"},
            )
        return not overview & BUSY

    def _overview(self) -> int:
        return self._register("bs")

    def _register(self, name: str) -> int:
        return decode_register(self._exchange(f"ch:{name}"), name)

    def _exchange(self, command: str) -> bytes:
        return self.transport.exchange(encode_line(command), until=END, timeout_s=ANSWER_S)
