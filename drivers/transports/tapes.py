r"""What is asked of a device whose wire is read by a library, kept as words and played again.

Each request is one line that a person can read, and so is its answer::

    > read holding 0 2              registers of Modbus: table, first register, count
    < 2512 701
    > write 5 100 200               function 16; `write-one` is function 6
    < taken
    > GET /api/1/status             HTTP: method, path and what was sent
    < 200 {"content-type": "application/json"}\n
    < {"state": "idle"}
    > read DB10 0 4                 S7: data block, first byte, count
    < 41a00000
    > read nsu=urn:a;i=7            OPC UA; `browse`, `describe`, `write` and `call` beside it
    < 21.5

Headers that a driver sends are left out, for they may hold a secret.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, TypeVar

import msgspec

from drivers.transports.base import Transport
from drivers.transports.http import Enough, HttpReply, HttpRequest, HttpTransport
from drivers.transports.modbus import RegisterTransport, Table
from drivers.transports.opcua.nodes import MethodSignature, Node, NodeName, Plain, Variable
from drivers.transports.opcua.transport import OpcUaTransport
from drivers.transports.replay import RecordedExchange, Script
from drivers.transports.s7.transport import S7Transport
from drivers.transports.sila.features import Feature
from drivers.transports.sila.transport import Progress, SilaTransport
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    RejectedError,
    UnreachableError,
)

T = TypeVar("T")
Line = TypeVar("Line", bound=Transport)
TAKEN = b"taken"
NO_TOKEN = "played.played."  # noqa: S105 - it opens nothing
"""What a driver is given that plays a transcript: there is nobody to show it to."""

ERRORS = {
    sort.__name__: sort
    for sort in (DeviceError, DeviceTimeoutError, FrameError, RejectedError, UnreachableError)
}


class Tape(ABC):
    """What runs beside a line."""

    @abstractmethod
    def say(self, request: str, ask: Callable[[], bytes]) -> bytes:
        """Return the answer to a request.

        Args:
            request: As the transcript writes it.
            ask: Asks the device.

        Raises:
            DeviceError: As the device's line raises it, or raised it when it was recorded.
        """


class RecordingTape(Tape):
    """Asks the device, and keeps what it answers."""

    def __init__(self) -> None:
        self.exchanges: list[RecordedExchange] = []

    def say(self, request: str, ask: Callable[[], bytes]) -> bytes:
        """Ask, and keep both."""
        said = request.encode()
        try:
            reply = ask()
        except DeviceError as error:
            sort = next(one.__name__ for one in type(error).__mro__ if one.__name__ in ERRORS)
            failure = f"{sort} {error.effect}: {error.message}"
            self.exchanges.append(RecordedExchange(">", said, b"", failure))
            raise
        self.exchanges.append(RecordedExchange(">", said, reply))
        return reply


class PlayingTape(Tape):
    """Answers from a transcript; no device is asked."""

    def __init__(self, exchanges: Sequence[RecordedExchange]) -> None:
        self._script = Script(exchanges)

    @property
    def remaining(self) -> list[bytes]:
        """Requests that were expected and have not come."""
        return self._script.remaining

    def say(self, request: str, ask: Callable[[], bytes]) -> bytes:  # noqa: ARG002 - nobody is asked
        """Answer as it was recorded."""
        found = self._script.answer(request.encode())
        if found.failure:
            what, _, message = found.failure.partition(": ")
            name, _, effect = what.partition(" ")
            raise ERRORS[name](message, effect=Effect(effect))
        if not found.reply:
            raise DeviceTimeoutError("no answer in the transcript")
        return found.reply


class Taped(Transport, Generic[Line]):
    """A line beside which a tape runs; without a line, only the tape answers."""

    def __init__(self, tape: Tape, line: Line | None) -> None:
        named = "replay:transcript" if line is None else line.url
        Transport.__init__(self, named, named if line is None else line.line)
        self._tape = tape
        self._inner = line
        self._is_played = False
        if line is not None:
            self.lock = line.lock

    @property
    def is_open(self) -> bool:
        """Tell whether the line is open."""
        return self._is_played if self._inner is None else self._inner.is_open

    def open(self) -> None:
        """Open the line."""
        self._is_played = True
        if self._inner is not None:
            self._inner.open()

    def close(self) -> None:
        """Close the line."""
        self._is_played = False
        if self._inner is not None:
            self._inner.close()

    def _open(self) -> None:
        self.open()

    def _close(self) -> None:
        self.close()

    @property
    def _device(self) -> Line:
        assert self._inner is not None  # noqa: S101 - a tape that plays asks nobody
        return self._inner

    def _say(self, request: str, ask: Callable[[], bytes]) -> bytes:
        with self.lock:
            return self._tape.say(request, ask)

    def _do(self, request: str, act: Callable[[], object]) -> None:
        def done() -> bytes:
            act()
            return TAKEN

        self._say(request, done)

    def _told(self, request: str, ask: Callable[[], T], sort: Any) -> T:  # noqa: ANN401 - a type
        found: T = msgspec.json.decode(
            self._say(request, lambda: msgspec.json.encode(ask())), type=sort
        )
        return found


class TapedRegisters(Taped[RegisterTransport], RegisterTransport):
    """Registers of Modbus."""

    def read_registers(
        self, address: int, count: int, *, table: Table = "holding"
    ) -> tuple[int, ...]:
        """Read registers."""

        def ask() -> bytes:
            found = self._device.read_registers(address, count, table=table)
            return " ".join(map(str, found)).encode()

        return tuple(int(one) for one in self._say(f"read {table} {address} {count}", ask).split())

    def write_registers(self, address: int, values: Sequence[int]) -> None:
        """Write registers by function 16."""
        request = " ".join(map(str, ("write", address, *values)))
        self._do(request, lambda: self._device.write_registers(address, values))

    def write_register(self, address: int, value: int) -> None:
        """Write one register by function 6."""
        request = f"write-one {address} {value}"
        self._do(request, lambda: self._device.write_register(address, value))


class TapedHttp(Taped[HttpTransport], HttpTransport):
    """Requests by HTTP."""

    def token(self) -> str:
        """Read the token; a transcript holds none."""
        return NO_TOKEN if self._inner is None else self._inner.token()

    def request(
        self,
        asked: HttpRequest,
        timeout_s: float,
        longest_bytes: int,
        enough: Enough = lambda _type, _body: False,
    ) -> HttpReply:
        """Make one request."""

        def ask() -> bytes:
            reply = self._device.request(asked, timeout_s, longest_bytes, enough)
            head = f"{reply.status} ".encode() + msgspec.json.encode(reply.headers)
            return head + b"\n" + reply.body

        body = "" if asked.body is None else f" {asked.body.decode()}"
        told, _, found = self._say(f"{asked.method} {asked.path}{body}", ask).partition(b"\n")
        status, _, headers = told.partition(b" ")
        if len(found) > longest_bytes:
            raise FrameError(f"a body of more than {longest_bytes} bytes")
        return HttpReply(int(status), msgspec.json.decode(headers, type=dict[str, str]), found)


class TapedS7(Taped[S7Transport], S7Transport):
    """Data blocks of an S7 controller."""

    def read(self, block: int, start: int, count: int) -> bytes:
        """Return bytes of a data block."""
        request = f"read DB{block} {start} {count}"
        found = self._say(request, lambda: self._device.read(block, start, count).hex().encode())
        return bytes.fromhex(found.decode())

    def write(self, block: int, start: int, data: bytes) -> None:
        """Write bytes of a data block."""
        request = f"write DB{block} {start} {data.hex()}"
        self._do(request, lambda: self._device.write(block, start, data))

    def keep_alive(self, block: int, start: int, every_s: float) -> None:
        """Count up beside what is asked; what is counted stands in no transcript."""
        if self._inner is not None:
            self._inner.keep_alive(block, start, every_s)


class TapedOpcUa(Taped[OpcUaTransport], OpcUaTransport):
    """Nodes of an OPC UA server."""

    def children(self, parent: NodeName | None) -> tuple[Node, ...]:
        """List what hangs below a node."""
        request = f"browse {parent or 'objects'}"
        return self._told(request, lambda: self._device.children(parent), tuple[Node, ...])

    def read(self, node: NodeName, what: str) -> Plain:
        """Return the value of a variable."""
        return self._told(f"read {node}", lambda: self._device.read(node, what), Plain)

    def write(self, node: NodeName, value: float, what: str) -> None:
        """Write a number."""
        self._do(f"write {node} {value:g}", lambda: self._device.write(node, value, what))

    def call(self, owner: NodeName, method: NodeName, *numbers: float, what: str) -> None:
        """Call a method of an object."""
        request = " ".join(["call", str(owner), str(method), *(f"{one:g}" for one in numbers)])
        self._do(request, lambda: self._device.call(owner, method, *numbers, what=what))

    def variable(self, node: NodeName) -> Variable:
        """Return what a variable says of itself."""
        return self._told(
            f"describe variable {node}", lambda: self._device.variable(node), Variable
        )

    def method(self, node: NodeName) -> MethodSignature:
        """Return what a method says of itself."""
        return self._told(
            f"describe method {node}", lambda: self._device.method(node), MethodSignature
        )


class TapedSila(Taped[SilaTransport], SilaTransport):
    """Features of a SiLA 2 server."""

    def feature(self, feature_id: str) -> Feature:
        """Return what the server says of one of its features."""
        return self._told(f"define {feature_id}", lambda: self._device.feature(feature_id), Feature)

    def read(self, feature: Feature, name: str) -> Any:  # noqa: ANN401 - any plain value
        """Return what a property tells."""
        return self._told(
            f"read {feature.id}/{name}", lambda: self._device.read(feature, name), Any
        )

    def call(self, feature: Feature, name: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Run a command that is answered once it is done."""
        return self._told(
            _command("call", feature, name, arguments),
            lambda: self._device.call(feature, name, arguments),
            dict[str, Any],
        )

    def begin(self, feature: Feature, name: str, arguments: Mapping[str, Any]) -> str:
        """Begin a command that may be watched."""
        return self._told(
            _command("begin", feature, name, arguments),
            lambda: self._device.begin(feature, name, arguments),
            str,
        )

    def progress(self, feature: Feature, name: str, number: str) -> Progress:
        """Tell how far the execution of a command is."""
        request = f"watch {feature.id}/{name} {number}"
        return self._told(request, lambda: self._device.progress(feature, name, number), Progress)

    def result(self, feature: Feature, name: str, number: str) -> dict[str, Any]:
        """Return what an execution that is over has answered."""
        request = f"result {feature.id}/{name} {number}"
        return self._told(
            request, lambda: self._device.result(feature, name, number), dict[str, Any]
        )


def _command(verb: str, feature: Feature, name: str, arguments: Mapping[str, Any]) -> str:
    return f"{verb} {feature.id}/{name} {msgspec.json.encode(dict(arguments)).decode()}"


_TAPED: Mapping[str, tuple[type[Transport], type[Taped[Any]]]] = {
    "register": (RegisterTransport, TapedRegisters),
    "http": (HttpTransport, TapedHttp),
    "s7": (S7Transport, TapedS7),
    "opcua": (OpcUaTransport, TapedOpcUa),
    "sila": (SilaTransport, TapedSila),
}


def has_words(sort: str) -> bool:
    """Tell whether what crosses a line of this sort can be written as words."""
    return sort in _TAPED


def taped(tape: Tape, sort: str, line: Transport | None = None) -> Transport:
    """Return a line of a sort with a tape beside it.

    Args:
        tape: Records, or plays.
        sort: As transports name it; one that `has_words`.
        line: The device's; None: only the tape answers.
    """
    expected, made = _TAPED[sort]
    if line is not None and not isinstance(line, expected):
        raise TypeError(f"{line.url} is no line of the sort {sort}")
    return made(tape, line)
