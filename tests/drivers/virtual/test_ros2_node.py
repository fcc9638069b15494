"""Settings and addresses of a ROS 2 node; `tests/ros2` drives a real one."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.transports.ros2.transport import Ros2Transport
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
