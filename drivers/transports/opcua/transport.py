"""A line to an OPC UA server: security policy None, anonymous.

What is asked for is the same for each device; which nodes it has a driver finds by their browse
names and types. The library is imported when a line is opened: other hosts lack it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from math import isfinite
from typing import TYPE_CHECKING, Any, ClassVar

from drivers.transports.base import Transport
from drivers.transports.opcua.nodes import MethodSignature, Node, NodeName, Plain, Variable
from drivers.transports.tcp import tcp_line
from labweb.domain.errors import Effect, FrameError, UnreachableError

if TYPE_CHECKING:
    from drivers.transports.opcua.link import OpcUaLink

ANSWER_S = 5.0


class OpcUaTransport(Transport):
    """One server with one session; requests go one at a time."""

    sort: ClassVar[str] = "opcua"

    def __init__(self, url: str, host: str, port: int) -> None:
        super().__init__(url, tcp_line(host, port))
        self._link: OpcUaLink | None = None

    @property
    def is_open(self) -> bool:
        """Tell whether there is a session, as far as is known."""
        return self._link is not None and self._link.is_connected

    def _open(self) -> None:
        self._close()
        try:
            module = import_module("drivers.transports.opcua.link")
        except ImportError as error:
            text = f"{error}: this host lacks the extra edge-opcua"
            raise UnreachableError(text, effect=Effect.NONE) from error
        link = module.OpcUaLink(self.url, self.line, ANSWER_S)
        link.open()
        self._link = link

    def _close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def children(self, parent: NodeName | None) -> tuple[Node, ...]:
        """List what hangs below a node; None is the folder of all objects.

        Raises:
            UnreachableError: No session (NONE), or it broke (UNKNOWN).
            DeviceTimeoutError: No answer in time; UNKNOWN.
            RejectedError: There is no such node; NONE.
            FrameError: The answer cannot be read; UNKNOWN.
        """
        with self._asking("browse", parent) as link:
            return link.children(parent)

    def read(self, node: NodeName, what: str) -> Plain:
        """Return the value of a variable.

        Args:
            node: Which.
            what: How errors name it.

        Raises:
            DeviceError: As `children`; code `device.alarm` where its quality is not good.
        """
        with self._asking("read", node) as link:
            value = link.read(node, what)
            self._observe("in", _line("read", node, value))
            return value

    def read_number(self, node: NodeName, what: str) -> float:
        """Return the value of a variable that is a number.

        Raises:
            DeviceError: As `read`; FrameError where it is no number.
        """
        value = self.read(node, what)
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            raise FrameError(f"{what} is {value!r} and no number", context={"line": self.line})
        return float(value)

    def write(self, node: NodeName, value: float, what: str) -> None:
        """Write a number.

        Raises:
            DeviceError: As `children`. RejectedError: it was not taken, and nothing moved.
        """
        with self._asking("write", node, value) as link:
            link.write(node, value, what)

    def call(self, owner: NodeName, method: NodeName, *numbers: float, what: str) -> None:
        """Call a method of an object.

        Raises:
            DeviceError: As `children`. RejectedError: it was not begun; any other bad
                status code leaves the outcome UNKNOWN.
        """
        with self._asking("call", method, *numbers) as link:
            link.call(owner, method, numbers, what)

    def variable(self, node: NodeName) -> Variable:
        """Return type, access, unit and range of a variable.

        Raises:
            DeviceError: As `children`.
        """
        with self._asking("describe", node) as link:
            return link.variable(node)

    def method(self, node: NodeName) -> MethodSignature:
        """Return the arguments of a method.

        Raises:
            DeviceError: As `children`.
        """
        with self._asking("describe", node) as link:
            return link.method(node)

    @contextmanager
    def _asking(self, service: str, node: NodeName | None, *values: float) -> Iterator[OpcUaLink]:
        """Keep the line for one request; a session that is lost is closed, and not opened again."""
        with self.lock:
            self._require_open()
            if self._link is None:
                raise UnreachableError("the line is not open: connect again", effect=Effect.NONE)
            self._observe("out", _line(service, node, *values))
            try:
                yield self._link
            except UnreachableError:
                self._close()
                raise


def _line(service: str, node: NodeName | None, *values: Any) -> bytes:  # noqa: ANN401 - any JSON
    return json.dumps([service, str(node or ""), *values], ensure_ascii=False).encode()
