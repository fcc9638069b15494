"""Mettler-Toledo balance that speaks MT-SICS level 0 and 1.

Protocol: MT-SICS, 9600 8N1, text lines CR LF; one command, one answer.
Quality: bronze, simulated instrument.
Safe state: idle; a balance moves nothing.

A steady weight is awaited by asking again and again instead of by the waiting command `S`,
so that a stop is heard and the line stays free for others.

No accuracy is stated: MT-SICS is spoken by balances of every class, and the balance's own data
sheet has its figures.

Source:
    Mettler-Toledo, MT-SICS reference manual, levels 0 and 1.
"""

from __future__ import annotations

import re
from typing import Annotated, ClassVar, NamedTuple

import msgspec

from drivers.base import (
    Driver,
    Range,
    Report,
    action,
    before_acting,
    status,
)
from drivers.interfaces.balance import Balance
from drivers.interfaces.showing import Showing
from drivers.transports.base import ByteTransport
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    FrameError,
    PreconditionError,
    RejectedError,
)

END = b"\r\n"
ANSWER_S = 2.0
TARE_S = 60.0

MG_PER_UNIT = {"g": 1000.0, "mg": 1.0, "kg": 1_000_000.0}

REFUSALS = {
    "I": "cannot do this now: it is moving or busy",
    "L": "does not know this parameter",
    "+": "is overloaded",
    "-": "is underloaded",
}


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One balance."""

    serial_number: str = ""
    """Refuse a balance with another number; "" accepts any."""

    stable_limit_s: Annotated[float, Range(0.1, 600.0)] = 60.0
    """Longest time to wait for a steady reading."""

    poll_s: Annotated[float, Range(0.005, 10.0)] = 0.3


class Weight(NamedTuple):
    """A decoded weight."""

    is_stable: bool
    mass_mg: float


def encode_line(command: str) -> bytes:
    r"""Build the frame of a command.

    Example:
        >>> encode_line("SI")
        b'SI\r\n'
    """
    return f"{command}\r\n".encode("ascii")


def decode_weight(frame: bytes, command: str) -> Weight:
    r"""Read the weight in the answer to S, SI or T.

    Raises:
        RejectedError: The balance refused, by its manual without a change.
        FrameError: Not an answer to this command.

    Example:
        >>> decode_weight(b"S S     100.0012 g\r\n", "S")
        Weight(is_stable=True, mass_mg=100001.2)
    """
    text = _text(frame)
    refuse(text, command)
    match = re.fullmatch(
        rf"{re.escape(command)} ([SD]) +(-?[0-9]+(?:\.[0-9]+)?) +(g|mg|kg) *", text
    )
    if match is None:
        raise FrameError(f"answer to {command} is no weight", context={"frame": frame.hex()})
    return Weight(match[1] == "S", round(float(match[2]) * MG_PER_UNIT[match[3]], 6))


def decode_serial(frame: bytes) -> str:
    r"""Read the serial number in the answer to I4.

    Raises:
        FrameError: Not such an answer.

    Example:
        >>> decode_serial(b'I4 A "B021002593"\r\n')
        'B021002593'
    """
    refuse(_text(frame), "I4")
    match = re.fullmatch(r'I4 A "([^"]{1,40})"', _text(frame).strip())
    if match is None:
        raise FrameError("answer to I4 is no serial number", context={"frame": frame.hex()})
    return match[1]


def refuse(text: str, command: str) -> None:
    """Turn the protocol's refusals into an error.

    Raises:
        RejectedError: The answer is a refusal.
        DeviceError: The balance reports a fault of its own.
    """
    first, _, rest = text.strip().partition(" ")
    if first in {"ES", "EL", "ET"}:
        raise RejectedError(f"balance answered {first} to {command}", context={"answer": first})
    if first == command and rest.strip() in REFUSALS:
        raise RejectedError(f"balance {REFUSALS[rest.strip()]}", context={"answer": rest.strip()})
    if first == command and "Error" in rest:
        raise DeviceError(f"balance reports {rest.strip()}", context={"answer": rest.strip()})


class MettlerSics(Driver[ByteTransport, Config], Balance, Showing):
    """One balance."""

    transport_type: ClassVar[type] = ByteTransport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def identify(self) -> None:
        """Ask for the serial number, and refuse another balance than the one set."""
        serial_number = decode_serial(self._exchange("I4"))
        if self.config.serial_number not in {"", serial_number}:
            raise RejectedError(
                f"balance {serial_number!r} answers, expected {self.config.serial_number!r}",
                context={"serial_number": serial_number},
            )

    def halt(self) -> None:
        """Nothing to send: a balance moves nothing, and the waiting thread sees the stop."""

    @status(every_s=1.0)
    def mass_mg(self) -> float:
        """Tell the reading now, steady or not."""
        return self._weight().mass_mg

    @status(every_s=1.0)
    def is_stable(self) -> bool:
        """Tell whether the reading is steady."""
        return self._weight().is_stable

    @action(timeout_s=700.0, recovery="R1")
    def tare(self) -> Report:
        """Take what is on the pan as zero, once it is steady.

        Effect:
            None on matter; later readings are net of this tare.
        """
        self.refuse_if_stopped()
        with before_acting():
            self._await_stable()
            self.pause(0)
        answer = self.transport.exchange(encode_line("T"), until=END, timeout_s=TARE_S)
        tared = decode_weight(answer, "T")
        return Report(evidence={"tare_mg": tared.mass_mg})

    @action(timeout_s=700.0, recovery="R1", operation="read")
    def weigh(self) -> Report:
        """Wait until the reading is steady and return it as evidence `mass_mg`.

        Raises:
            DeviceTimeoutError: It did not become steady in time; nothing moved.

        Effect:
            None.
        """
        self.refuse_if_stopped()
        with before_acting():
            return Report(evidence={"mass_mg": self._await_stable().mass_mg})

    @action(timeout_s=70.0, recovery="R1", operation="read")
    def show_itself(self, text: str, shown_s: Annotated[float, Range(1.0, 60.0)]) -> Report:
        """Show a text on the display for a while, then the weight again.

        Args:
            text: At most 20 printable ASCII signs without quotation marks; a small display cuts it.
            shown_s: For how long.

        Raises:
            PreconditionError: No display shows this text (NONE).
            RejectedError: It is busy, or has no display (NONE).
            DeviceError: It failed or was stopped; the text may stand there still (NONE).

        Effect:
            None.
        """
        self.refuse_if_stopped()
        if not re.fullmatch(r"[ !#-~]{1,20}", text):
            raise PreconditionError(f'{text[:40]!r} is no text of 1 to 20 plain signs without "')
        with before_acting():
            self._show(f'D "{text}"', "D")
            try:
                self.pause(shown_s)
            finally:
                self._show("DW", "DW")
        return Report(evidence={"text": text})

    def _show(self, command: str, name: str) -> None:
        answer = _text(self._exchange(command))
        refuse(answer, name)
        if answer != f"{name} A":
            raise FrameError(f"answer to {name} is {answer!r}")

    def _await_stable(self) -> Weight:
        deadline_s = self.deadline_s(self.config.stable_limit_s)
        while not (weight := self._weight()).is_stable:
            if self.now_s() > deadline_s:
                raise DeviceTimeoutError(
                    f"no steady weight in {self.config.stable_limit_s:g} s",
                    context={"mass_mg": weight.mass_mg},
                )
            self.pause(self.config.poll_s)
        return weight

    def _weight(self) -> Weight:
        # By the manual SI is answered as S is; some models repeat SI itself.
        answer = self._exchange("SI")
        return decode_weight(b"S" + answer[2:] if answer.startswith(b"SI ") else answer, "S")

    def _exchange(self, command: str) -> bytes:
        return self.transport.exchange(encode_line(command), until=END, timeout_s=ANSWER_S)


def _text(frame: bytes) -> str:
    try:
        return frame.removesuffix(END).decode("ascii")
    except UnicodeDecodeError as error:
        raise FrameError("answer is not text", context={"frame": frame.hex()}) from error
