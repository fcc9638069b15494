"""One session with an OPC UA server, by asyncua on an event loop of its own.

It never connects again by itself: a request that got lost is not sent a second time.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Awaitable, Callable
from concurrent.futures import TimeoutError as LateError
from typing import Any, TypeVar

from asyncua import Client, ua
from asyncua.client.ua_client import UASocketState

from drivers.transports.opcua.codes import failure
from drivers.transports.opcua.nodes import (
    EngineeringUnit,
    MethodArgument,
    MethodSignature,
    Node,
    NodeKind,
    NodeName,
    Plain,
    Variable,
)
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    UnreachableError,
)

T = TypeVar("T")
MANY = 10
"""Most requests behind one description."""

GRACE_S = 1.0
"""How much longer than the session itself a caller waits for it."""

_KINDS: dict[int, NodeKind] = {
    int(ua.NodeClass.Object): "object",
    int(ua.NodeClass.Variable): "variable",
    int(ua.NodeClass.Method): "method",
}
logging.getLogger("asyncua").setLevel(logging.CRITICAL)


class OpcUaLink:
    """A session; every method blocks, and may be called from any thread."""

    def __init__(self, url: str, line: str, timeout_s: float) -> None:
        """Begin nothing.

        Args:
            url: `opc.tcp://host:port/path`.
            line: As errors name it.
            timeout_s: Longest wait for each answer.
        """
        self._line = line
        self._timeout_s = timeout_s
        self._uris: list[str] = []
        self._client = Client(url, timeout=timeout_s, auto_reconnect=False)
        self._client.name = self._client.description = "labweb"
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name=line, daemon=True)

    @property
    def is_connected(self) -> bool:
        """Tell whether the connection still stands, as far as is known."""
        protocol = self._client.uaclient.protocol
        return protocol is not None and protocol.state is UASocketState.OPEN

    def open(self) -> None:
        """Connect, open a channel without security and a session of nobody in particular.

        Raises:
            DeviceError: It did not work; the effect is NONE.
        """
        self._thread.start()
        try:
            self._uris = self._run(self._connect, "a session", 6 * self._timeout_s)
        except DeviceError as error:
            error.effect = Effect.NONE
            self.close()
            raise

    async def _connect(self) -> list[str]:
        await self._client.connect()
        return [str(uri) for uri in await self._client.get_namespace_array()]

    def close(self) -> None:
        """End session, connection and thread. May be called twice."""
        if self._loop.is_closed():
            return
        done = asyncio.run_coroutine_threadsafe(self._disconnect(), self._loop)
        try:
            done.exception(4 * self._timeout_s)
        except LateError:
            done.cancel()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _disconnect(self) -> None:
        protocol = self._client.uaclient.protocol
        try:
            if self.is_connected:
                await self._client.disconnect()
            else:
                await self._client.disconnect_sessionless()
        finally:
            if protocol is not None and protocol.transport is not None:
                protocol.transport.abort()
            await asyncio.sleep(0)
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)

    def _run(self, work: Callable[[], Awaitable[T]], what: str, timeout_s: float) -> T:
        async def working() -> T:
            return await work()

        done = asyncio.run_coroutine_threadsafe(working(), self._loop)
        try:
            error = done.exception(timeout_s + GRACE_S)
        except LateError as late:
            done.cancel()
            raise self._failure(late, what) from late
        if error is not None:
            raise self._failure(error, what) from error
        return done.result()

    def _failure(self, error: BaseException, what: str) -> DeviceError:
        context = {"line": self._line}
        if isinstance(error, ua.UaStatusCodeError):
            return failure(ua.StatusCode(error.code).name, what, self._line)
        if isinstance(error, TimeoutError):
            return DeviceTimeoutError(f"{what}: no whole answer in time", context=context)
        if isinstance(error, OSError):
            return UnreachableError(
                f"{what}: the line broke: {error}", effect=Effect.UNKNOWN, context=context
            )
        return FrameError(f"{what}: the answer cannot be read: {error!r}", context=context)

    # -- questions

    def children(self, parent: NodeName | None) -> tuple[Node, ...]:
        """List what hangs below a node; None is the folder of all objects."""
        return self._run(lambda: self._children(parent), "what it has", self._timeout_s)

    async def _children(self, parent: NodeName | None) -> tuple[Node, ...]:
        node = self._client.nodes.objects if parent is None else self._node(parent)
        return tuple(self._seen(one) for one in await node.get_children_descriptions())

    def _seen(self, one: Any) -> Node:  # noqa: ANN401 - the library's class
        kind = _KINDS.get(int(one.NodeClass), "other")
        has_type = kind in {"object", "variable"} and not one.TypeDefinition.is_null()
        return Node(
            self._name(one.NodeId),
            str(one.BrowseName.Name),
            self._uri(one.BrowseName.NamespaceIndex),
            kind,
            self._name(one.TypeDefinition) if has_type else None,
        )

    def read(self, name: NodeName, what: str) -> Plain:
        """Return the value of a variable that is good."""
        return self._run(lambda: self._read(name, what), what, self._timeout_s)

    async def _read(self, name: NodeName, what: str) -> Plain:
        found = await self._node(name).read_data_value(raise_on_bad_status=False)
        if found.StatusCode is not None and not found.StatusCode.is_good():
            raise failure(found.StatusCode.name, what, self._line)
        return self._plain(found.Value.Value, what)

    def _plain(self, value: object, what: str) -> Plain:
        if isinstance(value, ua.LocalizedText):
            return str(value.Text or "")
        if isinstance(value, ua.NodeId):
            return str(self._name(value))
        if value is None or isinstance(value, bool | int | float | str):
            return value
        raise FrameError(f"{what}: a value of type {type(value).__name__} is not plain")

    def write(self, name: NodeName, value: float, what: str) -> None:
        """Write a number of type Double, without times of our own."""
        data = ua.DataValue(ua.Variant(value, ua.VariantType.Double))
        self._run(
            lambda: self._node(name).write_attribute(ua.AttributeIds.Value, data),
            what,
            self._timeout_s,
        )

    def call(
        self, owner: NodeName, method: NodeName, numbers: tuple[float, ...], what: str
    ) -> None:
        """Call a method whose arguments are numbers of type Double."""
        values = [ua.Variant(one, ua.VariantType.Double) for one in numbers]
        self._run(
            lambda: self._node(owner).call_method(self._id(method), *values), what, self._timeout_s
        )

    # -- descriptions

    def variable(self, name: NodeName) -> Variable:
        """Return what a variable says about itself."""
        return self._run(lambda: self._variable(name), "what it is", MANY * self._timeout_s)

    async def _variable(self, name: NodeName) -> Variable:
        node = self._node(name)
        found = await node.read_attributes(
            [
                ua.AttributeIds.DataType,
                ua.AttributeIds.ValueRank,
                ua.AttributeIds.UserAccessLevel,
                ua.AttributeIds.Description,
            ]
        )
        data_type, rank, access, doc = (one.Value.Value for one in found)
        properties = {
            str((await one.read_browse_name()).Name): one for one in await node.get_properties()
        }
        unit = await self._property(properties.get("EngineeringUnits"), ua.EUInformation)
        limits = await self._property(properties.get("EURange"), ua.Range)
        return Variable(
            self._name(data_type),
            int(rank),
            is_readable=bool(access & ua.AccessLevel.CurrentRead.mask),
            is_writable=bool(access & ua.AccessLevel.CurrentWrite.mask),
            unit=None if unit is None else _unit(unit),
            low=None if limits is None else float(limits.Low),
            high=None if limits is None else float(limits.High),
            doc=str(doc.Text or "") if doc is not None else "",
        )

    async def _properties(self, node: Any) -> dict[str, Any]:  # noqa: ANN401 - the library's class
        found = await node.get_properties()
        return {str((await one.read_browse_name()).Name): one for one in found}

    async def _property(self, node: Any, sort: type[T]) -> T | None:  # noqa: ANN401 - the library's
        if node is None:
            return None
        value = await node.read_data_value(raise_on_bad_status=False)
        found = value.Value.Value if value.StatusCode.is_good() else None
        return found if isinstance(found, sort) else None

    def method(self, name: NodeName) -> MethodSignature:
        """Return what a method says about itself."""
        return self._run(lambda: self._method(name), "what it takes", MANY * self._timeout_s)

    async def _method(self, name: NodeName) -> MethodSignature:
        node = self._node(name)
        found = await node.read_attributes(
            [ua.AttributeIds.UserExecutable, ua.AttributeIds.Description]
        )
        properties = {
            str((await one.read_browse_name()).Name): one for one in await node.get_properties()
        }
        doc = found[1].Value.Value
        return MethodSignature(
            await self._arguments(properties.get("InputArguments")),
            await self._arguments(properties.get("OutputArguments")),
            is_executable=bool(found[0].Value.Value),
            doc=str(doc.Text or "") if doc is not None else "",
        )

    async def _arguments(self, node: Any) -> tuple[MethodArgument, ...]:  # noqa: ANN401 - the library's
        values = [] if node is None else await node.read_value() or []
        return tuple(
            MethodArgument(
                str(one.Name),
                self._name(one.DataType),
                int(one.ValueRank),
                str(one.Description.Text or ""),
            )
            for one in values
        )

    # -- names

    def _uri(self, index: int) -> str:
        if index >= len(self._uris):
            raise FrameError(f"namespace {index} is not listed", context={"listed": self._uris})
        return self._uris[index]

    def _name(self, found: Any) -> NodeName:  # noqa: ANN401 - the library's class
        uri = getattr(found, "NamespaceUri", None) or self._uri(found.NamespaceIndex)
        key = found.to_string().rpartition("ns=")[2]
        return NodeName(str(uri), key.partition(";")[2] or key)

    def _id(self, name: NodeName) -> Any:  # noqa: ANN401 - the library's class
        if name.uri not in self._uris:
            raise failure("BadNodeIdUnknown", str(name), self._line)
        return ua.NodeId.from_string(f"ns={self._uris.index(name.uri)};{name.key}")

    def _node(self, name: NodeName) -> Any:  # noqa: ANN401 - the library's class
        return self._client.get_node(self._id(name))


def _unit(found: Any) -> EngineeringUnit:  # noqa: ANN401 - the library's class
    text = found.DisplayName.Text if found.DisplayName is not None else ""
    return EngineeringUnit(str(found.NamespaceUri or ""), int(found.UnitId), str(text or ""))
