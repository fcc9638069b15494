"""A line to other nodes: what they tell, what they answer, what they carry out.

Imports of Cyclone DDS wait for the first use: a host without such devices does not have it.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

from drivers.transports.base import Transport
from drivers.transports.ros2.interfaces_table import INTERFACES
from drivers.transports.ros2.link import LinkSettings
from drivers.transports.ros2.message_definitions import Definitions
from labweb.domain.errors import Effect, UnreachableError

if TYPE_CHECKING:
    from drivers.transports.ros2.actions import ActionClient, GoalState
    from drivers.transports.ros2.bus import Bus, Client, Pending

Plain = dict[str, Any]


class Ros2Transport(Transport):
    """The nodes of one namespace in one domain. The line is theirs; several may listen to it."""

    sort: ClassVar[str] = "ros2"

    def __init__(self, url: str, settings: LinkSettings, namespace: str) -> None:
        super().__init__(url, f"ros2:{settings.address}:{settings.domain}{namespace}")
        self.namespace = namespace
        self._settings = settings
        self._definitions = Definitions(INTERFACES)
        self._bus: Bus | None = None
        self._heard: dict[tuple[str, str], tuple[float, Plain]] = {}
        self._listening: set[tuple[str, str]] = set()
        self._clients: dict[tuple[str, str], Client] = {}
        self._actions: dict[tuple[str, str], ActionClient] = {}
        self._making = threading.Lock()

    @property
    def is_open(self) -> bool:
        """Tell whether we take part in the domain."""
        return self._bus is not None

    def _open(self) -> None:
        try:
            bus = import_module("drivers.transports.ros2.bus")
            types = import_module("drivers.transports.ros2.types")
        except ImportError as error:
            text = f"{error}: this host lacks the extra edge-ros2"
            raise UnreachableError(text, effect=Effect.NONE) from error
        self._bus = bus.Bus(self._settings, types.Types(self._definitions))

    def _close(self) -> None:
        found, self._bus = self._bus, None
        for kept in (self._heard, self._clients, self._actions):
            kept.clear()
        self._listening.clear()
        if found is not None:
            found.close()

    def define(self, texts: Mapping[str, str]) -> None:
        """Learn interfaces, of which a driver has the texts.

        Raises:
            DefinitionError: One is malformed, or is known and differs.
        """
        self._definitions.add(texts)

    def listen(self, name: str, message: str) -> None:
        """Begin to listen to a topic; once is enough.

        Raises:
            DefinitionError: The name or the type is none.
            UnreachableError: The line is not open; effect NONE.
        """
        key = (self._full(name), message)
        with self._making:
            if key in self._listening:
                return
            self._joined().subscribe(*key, lambda value: self._keep(key, value))
            self._listening.add(key)

    def _keep(self, key: tuple[str, str], value: Plain) -> None:
        self._observe("in", _bytes(key[0], value))
        self._heard[key] = (time.monotonic(), value)

    def latest(self, name: str, message: str, *, longest_age_s: float) -> Plain | None:
        """Return what a topic told last; None: nothing, or too long ago."""
        found = self._heard.get((self._full(name), message))
        if found is None or time.monotonic() - found[0] > longest_age_s:
            return None
        return found[1]

    def call(self, name: str, kind: str, value: Mapping[str, Any], *, timeout_s: float) -> Plain:
        """Call a service.

        Raises:
            DefinitionError, UnreachableError: Nothing was sent; effect NONE.
            DeviceTimeoutError, FrameError: The effect is unknown.
        """
        key = (self._full(name), kind)
        with self._making:
            bus = self._joined()
            if key not in self._clients:
                self._clients[key] = bus.client(key[0], self._definitions.service(kind))
        client = self._clients[key]
        client.wait(timeout_s)
        self._observe("out", _bytes(key[0], value))
        answer = client.call(value, timeout_s)
        self._observe("in", _bytes(key[0], answer))
        return answer

    def action(self, name: str, kind: str) -> ActionClient:
        """Return the client of an action.

        Raises:
            DefinitionError: The name or the type is none.
            UnreachableError: The line is not open; effect NONE.
        """
        key = (self._full(name), kind)
        with self._making:
            bus = self._joined()
            if key not in self._actions:
                client = import_module("drivers.transports.ros2.actions").ActionClient
                self._actions[key] = client(bus, key[0], self._definitions.action(kind))
        return self._actions[key]

    def begin(
        self,
        action: tuple[str, str],
        goal: Mapping[str, Any],
        heard: Callable[[Plain], None],
        *,
        timeout_s: float,
    ) -> bytes:
        """Send a goal to an action, by name and type, and return its id once it is accepted.

        Raises:
            DefinitionError, UnreachableError, RejectedError: Nothing moved; effect NONE.
            DeviceTimeoutError: No word whether it was accepted; the effect is unknown.
        """
        client = self.action(*action)
        client.wait(timeout_s)
        self._observe("out", _bytes(self._full(action[0]), goal))
        return client.begin(goal, heard, timeout_s)

    def await_result(
        self,
        action: tuple[str, str],
        goal_id: bytes,
        *,
        timeout_s: float,
        pause: Callable[[Pending], Plain | None],
    ) -> tuple[GoalState, Plain]:
        """Wait for the end of a goal; `pause` waits for a while and may raise.

        Raises:
            UnreachableError, DeviceTimeoutError, FrameError: It may go on.
        """
        state, result = self.action(*action).await_result(goal_id, timeout_s, pause)
        self._observe("in", _bytes(self._full(action[0]), result))
        return state, result

    def _full(self, name: str) -> str:
        """Return the full name of one that is given within the namespace."""
        return name if name.startswith("/") else f"{self.namespace.rstrip('/')}/{name}"

    def _joined(self) -> Bus:
        self._require_open()
        if self._bus is None:
            raise UnreachableError("the line is not open", effect=Effect.NONE)
        return self._bus


def _bytes(name: str, value: Mapping[str, Any]) -> bytes:
    return json.dumps([name, value], ensure_ascii=False).encode()
