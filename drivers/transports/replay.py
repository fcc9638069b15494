r"""A transport that answers from a transcript: recorded bytes, one exchange after another.

A transcript is a text file. Bytes are written as in a Python bytes literal, without quotes::

    # comment
    >  /1?R\r           this request comes here, once
    <  /0`1500\x03\r\n  and this is its answer
    >* /1Q\r            this request may come here any number of times, or not at all
    >? /1TR\r           this request may come at any moment, any number of times

A request without an answer line is met with silence. What carries no bytes of its own, such as
registers, is written as words (`drivers.transports.tapes`); there an error stands for an answer::

    >  read holding 0 2
    !  RejectedError none: illegal register address
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.transports.base import ByteTransport, Direction, Ending, whole_length

_ONCE, _REPEATED, _ANYTIME = ">", ">*", ">?"
_UUID = re.compile(rb"[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}")


class TranscriptMismatchError(AssertionError):
    """The driver asked something that the transcript does not hold at this place."""


@dataclass(frozen=True, slots=True)
class RecordedExchange:
    """One recorded request and what came back."""

    mark: str
    request: bytes
    reply: bytes
    """b"": silence."""

    failure: str = ""
    """The error that came instead: its class, its effect, a colon and what it said."""


class Script:
    """The instrument's part of a transcript; it insists on the driver's."""

    def __init__(self, exchanges: Sequence[RecordedExchange]) -> None:
        self.steps = [one for one in exchanges if one.mark != _ANYTIME]
        """What comes in its turn."""

        self.anytime = {one.request: one for one in exchanges if one.mark == _ANYTIME}
        """By request: what may come at any moment."""

        self._next = 0
        self._names: dict[bytes, bytes] = {}
        """By the random name that was recorded: the one that the driver has made now."""

    @property
    def remaining(self) -> list[bytes]:
        """Requests that were expected and have not come."""
        return [one.request for one in self.steps[self._next :] if one.mark == _ONCE]

    def answer(self, request: bytes) -> RecordedExchange:
        """Return the exchange that holds the answer to a request.

        Random names (UUIDs) that a driver makes stand for those that it had made when it was
        recorded, in requests and in answers.

        Raises:
            TranscriptMismatchError: It is not expected here.
        """
        for one in self.anytime.values():
            if self._is_same(one.request, request):
                return self._named(one)
        for position in range(self._next, len(self.steps)):
            one = self.steps[position]
            if self._is_same(one.request, request):
                self._next = position if one.mark == _REPEATED else position + 1
                return self._named(one)
            if one.mark == _ONCE:
                raise TranscriptMismatchError(
                    f"sent {request!r}, the transcript expects {one.request!r}"
                )
        raise TranscriptMismatchError(f"sent {request!r} after the transcript's end")

    def _is_same(self, recorded: bytes, request: bytes) -> bool:
        if recorded == request:
            return True
        if _UUID.sub(b"", recorded) != _UUID.sub(b"", request):
            return False
        pairs = list(zip(_UUID.findall(recorded), _UUID.findall(request), strict=True))
        if any(self._names.get(old, new) != new for old, new in pairs):
            return False
        self._names.update(pairs)
        return True

    def _named(self, one: RecordedExchange) -> RecordedExchange:
        reply = _UUID.sub(lambda found: self._names.get(found[0], found[0]), one.reply)
        return replace(one, reply=reply)


class ReplayTransport(ByteTransport):
    """Plays the instrument's part of a transcript, and insists on the driver's."""

    def __init__(
        self, exchanges: Sequence[RecordedExchange], *, line: str = "replay:transcript"
    ) -> None:
        super().__init__(line, line)
        self.script = Script(exchanges)
        self._pending = b""
        self._is_open = False
        self.sent: list[bytes] = []
        """Every request, in order."""

    @classmethod
    def from_file(cls, path: Path) -> ReplayTransport:
        """Read a transcript file.

        Raises:
            ValueError: A line cannot be read; the message has its number.
        """
        return cls(parse_transcript(path.read_text(encoding="utf-8")), line=f"replay:{path}")

    @property
    def is_open(self) -> bool:
        """Tell whether the transcript is in use."""
        return self._is_open

    @property
    def remaining(self) -> list[bytes]:
        """Requests that were expected and have not come."""
        return self.script.remaining

    def _open(self) -> None:
        self._is_open = True

    def _close(self) -> None:
        self._is_open = False

    def _put(self, data: bytes) -> None:
        self.sent.append(data)
        self._pending = self.script.answer(data).reply

    def _take(self, timeout_s: float) -> bytes:  # noqa: ARG002 - nothing here takes time
        reply, self._pending = self._pending, b""
        return reply

    def _read(
        self,
        until: Ending,
        deadline_s: float,
        longest_bytes: int,
        unless: Callable[[], bool] | None = None,
    ) -> bytes:
        length = whole_length(self._pending, until)
        is_whole = length is not None and length <= len(self._pending)
        return super()._read(until, deadline_s if is_whole else 0.0, longest_bytes, unless)


def parse_transcript(text: str) -> list[RecordedExchange]:
    """Read the exchanges of a transcript.

    Raises:
        ValueError: A line is neither request, answer nor comment.
    """
    exchanges: list[RecordedExchange] = []
    for number, line in enumerate(text.splitlines(), start=1):
        mark, _, rest = line.strip().partition(" ")
        if not mark or mark.startswith("#"):
            continue
        if mark in {_ONCE, _REPEATED, _ANYTIME}:
            exchanges.append(RecordedExchange(mark, _bytes(rest, number), b""))
        elif mark == "<" and exchanges:
            last = exchanges[-1]
            exchanges[-1] = replace(last, reply=last.reply + _bytes(rest, number))
        elif mark == "!" and exchanges:
            exchanges[-1] = replace(exchanges[-1], failure=rest.strip())
        else:
            raise ValueError(f"transcript line {number} is neither request, answer nor comment")
    return exchanges


def render_transcript(exchanges: Iterable[RecordedExchange], head: Iterable[str] = ()) -> str:
    r"""Write exchanges as a transcript, with comments before them; `parse_transcript` reads it.

    Example:
        >>> print(render_transcript([Exchange(">", b"SI\r\n", b"S S 1.0 g\r\n")]), end="")
        > SI\r\n
        < S S 1.0 g\r\n
    """
    lines = [f"# {' '.join(text.splitlines())}" for text in head]
    for one in exchanges:
        lines.append(f"{one.mark} {_text(one.request)}")
        lines += [f"< {_text(one.reply)}"] if one.reply else []
        lines += [f"! {' '.join(one.failure.split())}"] if one.failure else []
    return "".join(f"{line}\n" for line in lines)


class Recording:
    """An observer of a line that keeps what crosses it as exchanges.

    Set it as `transport.observer` before the line is opened.
    """

    def __init__(self) -> None:
        self._crossed: list[tuple[bytes, bytearray]] = []
        self.unasked = bytearray()
        """What came before anything was sent: no transcript can hold it."""

    def __call__(self, direction: Direction, data: bytes) -> None:
        """Keep one piece; pieces of one answer belong together."""
        if direction == "out":
            self._crossed.append((bytes(data), bytearray()))
        elif self._crossed:
            self._crossed[-1][1].extend(data)
        else:
            self.unasked.extend(data)

    @property
    def exchanges(self) -> list[RecordedExchange]:
        """Return every request with what came until the next one."""
        return [RecordedExchange(_ONCE, request, bytes(reply)) for request, reply in self._crossed]


def _text(data: bytes) -> str:
    text = repr(data)[2:-1]
    if text.startswith(" "):
        text = f"\\x20{text[1:]}"
    return f"{text[:-1]}\\x20" if text.endswith(" ") else text


def _bytes(text: str, number: int) -> bytes:
    try:
        value = ast.literal_eval('b"' + text.strip().replace('"', '\\"') + '"')
    except (SyntaxError, ValueError) as error:
        raise ValueError(f"transcript line {number}: {error}") from error
    if not isinstance(value, bytes):
        raise ValueError(f"transcript line {number} is not bytes")
    return value
