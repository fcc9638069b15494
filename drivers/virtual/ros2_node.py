"""A node of ROS 2, by the topics, services and actions that are listed for it.

Protocol: ROS 2 over DDS; the interfaces of the node, whose texts stand in the settings.
Quality: bronze, driven against rclpy.
Safe state: every goal of the listed actions is cancelled; what it does then is its own affair.

Only what is listed is offered. What a goal or a service does to matter nobody can tell from
here: one that did not succeed is unknown.

Source:
    ROS 2, "About ROS 2 interfaces" and the design article "Actions".
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import msgspec

from drivers.base import (
    DeviceStoppedError,
    Driver,
    Range,
    Report,
    action,
    status,
)
from drivers.interfaces.node import Node
from drivers.transports.ros2.transport import Ros2Transport
from labweb.domain.errors import (
    DefinitionError,
    DeviceError,
    Effect,
    PreconditionError,
    UnreachableError,
)

if TYPE_CHECKING:
    from drivers.transports.ros2.bus import Pending

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6  # action_msgs/msg/GoalStatus
WAIT_S = 0.1
_TOPIC_WORDS = (2, 3)
_OTHER_WORDS = 2


class Config(msgspec.Struct, frozen=True, kw_only=True):
    """One node."""

    definitions: dict[str, str] = {}
    """Texts of interfaces that labweb does not know, by full name: `nav/action/Go`."""

    topics: dict[str, str] = {}
    """What it tells, by name: topic, type and, if one field is meant, its way: `a.b`."""

    services: dict[str, str] = {}
    """What it answers, by name: service and type."""

    goals: dict[str, str] = {}
    """What it carries out, by name: action and type."""

    answer_limit_s: Annotated[float, Range(0.1, 60.0)] = 5.0
    """Longest time until a service answers, or a goal is accepted."""

    goal_limit_s: Annotated[float, Range(0.1, 3500.0)] = 600.0
    """Longest time that a goal may take."""

    silence_limit_s: Annotated[float, Range(0.1, 3600.0)] = 3.0
    """A topic that told nothing for so long is not known any more."""


class Ros2Node(Driver[Ros2Transport, Config], Node):
    """One node."""

    transport_type: ClassVar[type] = Ros2Transport
    config_type: ClassVar[type[msgspec.Struct]] = Config

    def __init__(self, transport: Ros2Transport, config: dict[str, Any]) -> None:
        """Read what is listed; nothing is opened.

        Raises:
            DefinitionError: An entry or an interface is malformed.
        """
        super().__init__(transport, config)
        transport.define(self.config.definitions)
        self._topics = {
            name: _words(name, text, _TOPIC_WORDS) for name, text in self.config.topics.items()
        }
        self._services = _entries(self.config.services)
        self._goals = _entries(self.config.goals)
        if not (self._topics or self._services or self._goals):
            raise DefinitionError("list a topic, a service or a goal", code="driver.config")
        self._feedback: dict[str, Any] = {}

    def identify(self) -> None:
        """Wait for a word of each topic, and for who serves, and ask nothing.

        Raises:
            UnreachableError: One of them is not there.
        """
        for topic, kind, *_ in self._topics.values():
            self.transport.listen(topic, kind)
        missing = self._missing()
        for _ in range(int(self.config.answer_limit_s / WAIT_S)):
            if not missing:
                return
            self.rest(WAIT_S)
            missing = self._missing()
        if missing:
            raise UnreachableError(f"nobody tells or serves {missing}", effect=Effect.NONE)

    def _missing(self) -> list[str]:
        silent = [name for name in self._topics if self._value(name) is None]
        unserved = [
            name
            for name, entry in self._goals.items()
            if not self.transport.action(*entry).is_served
        ]
        return silent + unserved

    def halt(self) -> None:
        """Cancel every goal of the listed actions.

        Not only the own one: a process that follows one that died does not know its goal.

        Raises:
            DeviceError: An action did not answer; its goal may go on. The others were asked.
        """
        failed: DeviceError | None = None
        for entry in self._goals.values():
            try:
                self.transport.action(*entry).cancel_all(self.config.answer_limit_s)
            except DeviceError as error:
                failed = failed or error
        if failed is not None:
            raise failed

    @status(every_s=0.1)
    def values(self) -> dict[str, Any]:
        """Tell what each topic told last; one that is silent is null."""
        return {name: self._value(name) for name in self._topics}

    @status(every_s=0.2)
    def feedback(self) -> dict[str, Any]:
        """Tell how far the goal is that is under way, in the node's words."""
        return dict(self._feedback)

    @status(every_s=1.0)
    def is_present(self) -> bool:
        """Tell whether everything that is listed is there."""
        return not self._missing()

    @action(timeout_s=3600.0, recovery="R3", hazards=("moving_parts",))
    def run_goal(self, goal: str, arguments: dict[str, Any]) -> Report:
        """Send a goal that is listed, and return once it has succeeded.

        Raises:
            PreconditionError: The goal is not listed, or the arguments do not fit it (NONE).
            UnreachableError: Nobody offers the action (NONE).
            RejectedError: The node does not accept the goal (NONE).
            DeviceError: It did not succeed, or nobody knows (UNKNOWN).

        Effect:
            All that the node does for the goal.
        """
        self.refuse_if_stopped()
        entry = _listed(self._goals, goal)
        self._feedback = {}
        try:
            goal_id = self.transport.begin(
                entry, arguments, self._take_feedback, timeout_s=self.config.answer_limit_s
            )
        except DefinitionError as error:
            raise _unfit(error) from error
        return self._finish(entry, goal_id, goal)

    def _finish(self, entry: tuple[str, str], goal_id: bytes, goal: str) -> Report:
        if self.is_stopped:  # it was stopped before the node had the goal
            self.transport.action(*entry).cancel(goal_id, self.config.answer_limit_s)
        try:
            state, result = self.transport.await_result(
                entry, goal_id, timeout_s=self.config.goal_limit_s, pause=_wait
            )
        except DeviceError as error:
            error.effect = Effect.UNKNOWN
            with contextlib.suppress(DeviceError):  # the first cause is the one that is told
                self.transport.action(*entry).cancel(goal_id, self.config.answer_limit_s)
            raise
        evidence = {"goal": goal, "state": int(state), "result": result}
        if state == CANCELED and self.is_stopped:
            raise DeviceStoppedError(f"{goal} was cancelled", context=evidence)
        if state != SUCCEEDED:
            word = {CANCELED: "was cancelled", ABORTED: "was aborted by the node"}
            text = f"{goal} {word.get(int(state), f'ended in state {int(state)}')}"
            raise DeviceError(text, code="device.alarm", context=evidence)
        return Report(evidence=evidence)

    @action(timeout_s=120.0, recovery="R3", hazards=("moving_parts",))
    def call(self, service: str, arguments: dict[str, Any]) -> Report:
        """Call a service that is listed, and return what it answered.

        Raises:
            PreconditionError: The service is not listed, or the arguments do not fit it (NONE).
            UnreachableError: Nobody serves (NONE).
            DeviceError: It did not answer (UNKNOWN).

        Effect:
            All that the node does for the call. Whether its answer is a good one, who reads it
            knows.
        """
        self.refuse_if_stopped()
        entry = _listed(self._services, service)
        try:
            answer = self.transport.call(*entry, arguments, timeout_s=self.config.answer_limit_s)
        except DefinitionError as error:
            raise _unfit(error) from error
        return Report(evidence={"service": service, "answer": answer})

    def _take_feedback(self, feedback: dict[str, Any]) -> None:
        self._feedback = feedback

    def _value(self, name: str) -> Any:  # noqa: ANN401 - any JSON value
        topic, kind, *way = self._topics[name]
        value: Any = self.transport.latest(topic, kind, longest_age_s=self.config.silence_limit_s)
        for part in way[0].split(".") if way else ():
            if not isinstance(value, dict) or part not in value:
                return None
            value = value[part]
        return value


def _wait(pending: Pending) -> dict[str, Any] | None:
    return pending.wait(WAIT_S)


def _words(name: str, text: str, counts: tuple[int, ...]) -> tuple[str, ...]:
    words = tuple(text.split())
    if len(words) not in counts:
        raise DefinitionError(f"{name}: {text!r} is no name and type", code="driver.config")
    return words


def _entries(listed: dict[str, str]) -> dict[str, tuple[str, str]]:
    found = {}
    for name, text in listed.items():
        words = _words(name, text, (_OTHER_WORDS,))
        found[name] = (words[0], words[1])
    return found


def _listed(entries: dict[str, tuple[str, str]], name: str) -> tuple[str, str]:
    if name not in entries:
        raise PreconditionError(
            f"{name!r} is not listed for this node",
            code="device.limit",
            context={"listed": sorted(entries)},
        )
    return entries[name]


def _unfit(error: DefinitionError) -> PreconditionError:
    return PreconditionError(error.message, code="driver.arguments")
