"""Settings and addresses of a ROS 2 node; `tests/ros2` drives a real one."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from drivers.transports.ros2.actions import ActionClient, ActionServer, Decide, Goal, GoalState
from drivers.transports.ros2.bus import Bus
from drivers.transports.ros2.interfaces_table import INTERFACES
from drivers.transports.ros2.link import LinkSettings
from drivers.transports.ros2.message_definitions import Definitions
from drivers.transports.ros2.transport import Ros2Transport
from drivers.transports.ros2.types import Types
from drivers.transports.urls import line_key, make_transport
from drivers.virtual.ros2_node import Ros2Node
from labweb.domain.errors import DefinitionError, PreconditionError, UnreachableError

BATTERY = {"battery": "battery std_msgs/msg/Float64 data"}


def a_node(**config: Any) -> Ros2Node:  # noqa: ANN401 - any setting
    transport = make_transport("ros2://127.0.0.1/arm_1?domain=120")
    assert isinstance(transport, Ros2Transport)
    return Ros2Node(transport, config)


@pytest.mark.parametrize(
    "config",
    [
        {},
        {"topics": {"x": "/only_a_name"}},
        {"goals": {"x": "go nav/action/Go left"}},
        {"definitions": {"std_msgs/msg/Bool": "int32 data"}, "topics": BATTERY},
        {"definitions": {"no name": "int32 data"}, "topics": BATTERY},
        {"topics": BATTERY, "goal_limit_s": 0.0},
    ],
)
def test_settings_that_cannot_be_are_refused(config: dict[str, Any]) -> None:
    with pytest.raises(DefinitionError):
        a_node(**config)


def test_what_is_not_listed_is_refused_before_anything_is_opened() -> None:
    node = a_node(topics=BATTERY)
    with pytest.raises(PreconditionError, match="not listed"):
        node.run_goal("go", {})
    with pytest.raises(PreconditionError, match="not listed"):
        node.call("home", {})
    assert not node.transport.is_open


def test_a_node_that_tells_nothing_is_unreachable_and_null() -> None:
    node = a_node(topics=BATTERY, answer_limit_s=0.2)
    with pytest.raises(UnreachableError) as caught:
        node.connect()
    assert caught.value.effect == "none"
    assert node.values() == {"battery": None}
    node.halt()
    node.close()


def test_addresses_of_nodes() -> None:
    assert line_key("ros2://192.0.2.7/arm_1?domain=3") == "ros2:192.0.2.7:3/arm_1"
    assert line_key("ros2://127.0.0.1") == "ros2:127.0.0.1:0/"
    for url in ("ros2://arm", "ros2://127.0.0.1:80/a", "ros2://127.0.0.1/a b", "ros2:///a",
                "ros2://127.0.0.1/a?domain=300", "ros2://127.0.0.1/a?peers=x"):  # fmt: skip
        with pytest.raises(DefinitionError):
            line_key(url)


GO, GO_TEXT = "nav/action/Go", "int32 order\n---\nint32 done\n---\nint32 left"


class Robot:
    """A node in a participant of its own that drives until its goal is cancelled."""

    def __init__(self, bus: Bus) -> None:
        self.begun, self.cancelled = threading.Event(), threading.Event()
        action = bus.types.definitions.action(GO)
        self.server = ActionServer(bus, "/arm_1/go", action, taken=self.take, cancel=self.cancel)

    def take(self, goal: Goal, decide: Decide) -> None:
        decide(True)
        self.server.move(goal, GoalState.EXECUTING)
        self.begun.set()

    def cancel(self, _: Goal) -> bool:
        self.cancelled.set()
        return True


@pytest.fixture
def robot() -> Iterator[tuple[Robot, int]]:
    domain = 110 + secrets.randbelow(90)
    bus = Bus(LinkSettings(domain=domain), Types(Definitions(INTERFACES, {GO: GO_TEXT})))
    yield Robot(bus), domain
    bus.close()


def test_a_process_that_follows_one_that_died_cancels_the_goal_that_it_does_not_know(
    robot: tuple[Robot, int],
) -> None:
    made, domain = robot

    dead = Bus(LinkSettings(domain=domain), Types(Definitions(INTERFACES, {GO: GO_TEXT})))
    client = ActionClient(dead, "/arm_1/go", dead.types.definitions.action(GO))
    client.wait(20.0)
    client.begin({"order": 5}, lambda _: None, 20.0)
    assert made.begun.wait(5.0)
    dead.close()
    transport = make_transport(f"ros2://127.0.0.1/arm_1?domain={domain}")
    assert isinstance(transport, Ros2Transport)
    config = {"definitions": {GO: GO_TEXT}, "goals": {"go": f"go {GO}"}, "answer_limit_s": 20.0}
    successor = Ros2Node(transport, config)
    successor.connect()
    assert not made.cancelled.is_set()
    successor.halt()
    assert made.cancelled.wait(5.0)
    successor.close()
