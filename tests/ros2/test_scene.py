"""The scene of a lab as real ROS 2 hears it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from drivers.transports.ros2.bus import Bus, Plain
from labweb.domain.errors import DefinitionError
from tests.ros2.conftest import Peer
from tests.twin.labs import body
from twin.robot import Robot, robot_of
from twin.state import Snapshot
from workers.ros2.scene import SceneTopics, begin

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.fixture
def robot() -> Robot:
    data = body()
    data["telemetry"] = {"d1": {"volume_ul": (1.0, 2500.0), "port_index": (1.0, 3)}}
    return robot_of(msgspec.convert(data, Snapshot))


@pytest.fixture
def telling(bus: Bus, robot: Robot) -> Iterator[SceneTopics]:
    scene, ending = SceneTopics(bus, lambda: 1_700_000_000.25), threading.Event()

    def tell() -> None:
        while not ending.wait(0.05):
            scene.hear(robot)

    thread = threading.Thread(target=tell, daemon=True)
    thread.start()
    yield scene
    ending.set()
    thread.join()


def test_who_comes_late_gets_the_description(
    peer: Peer, telling: SceneTopics, robot: Robot
) -> None:
    time.sleep(0.5)
    found = peer.ask(
        "listen", topic="/robot_description", type="std_msgs/msg/String", count=1, lasting=True
    )["found"]
    assert [message["data"] for _, message in found] == [robot.description]


def test_joints_reach_a_real_node(peer: Peer, telling: SceneTopics, robot: Robot) -> None:
    found = peer.ask("listen", topic="/joint_states", type="sensor_msgs/msg/JointState", count=3)
    _, message = found["found"][0]
    assert dict(zip(message["name"], message["position"], strict=True)) == robot.joints
    assert message["header"]["stamp"] == {"sec": 1_700_000_000, "nanosec": 250_000_000}


def test_transforms_are_told_under_the_name_and_type_that_tf2_listens_to(
    peer: Peer, bus: Bus, telling: SceneTopics, robot: Robot
) -> None:
    heard: list[Plain] = []
    bus.subscribe("/tf", "tf2_msgs/msg/TFMessage", heard.append)
    deadline_s = time.monotonic() + 20
    while not heard and time.monotonic() < deadline_s:
        time.sleep(0.05)
    told = {one["child_frame_id"]: one for one in heard[0]["transforms"]}
    assert set(told) == {one.child for one in robot.placed}
    bottle = told["bottle"]["transform"]
    assert bottle["translation"] == pytest.approx({"x": 0.1, "y": 0.3, "z": 0.03})
    assert bottle["rotation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    assert peer.ask("graph")["topics"]["/tf"] == ["tf2_msgs/msg/TFMessage"]


def test_a_transform_is_laid_out_as_a_real_node_reads_it(peer: Peer, bus: Bus) -> None:
    told = {
        "header": {"stamp": {"sec": 3}, "frame_id": "room"},
        "child_frame_id": "bottle",
        "transform": {"translation": {"x": 0.1, "y": -0.2, "z": 3.0}, "rotation": {"w": 1.0}},
    }
    publisher = bus.publisher("/one_transform", "geometry_msgs/msg/TransformStamped")
    peer.begin("listen", topic="/one_transform", type="geometry_msgs/msg/TransformStamped", count=1)
    deadline_s = time.monotonic() + 20
    while not publisher.listener_count and time.monotonic() < deadline_s:
        time.sleep(0.05)
    publisher.publish(told)
    _, message = peer.end()["found"][0]
    assert message["child_frame_id"] == "bottle"
    assert message["transform"]["translation"] == {"x": 0.1, "y": -0.2, "z": 3.0}


def test_nothing_is_told_while_nobody_knows_how_the_lab_is(bus: Bus) -> None:
    scene = SceneTopics(bus)
    scene.hear(None)
    assert scene._told == ""


def test_a_scene_needs_the_twin_s_configuration(bus: Bus, tmp_path: Path) -> None:
    with pytest.raises(DefinitionError):
        begin(bus, tmp_path / "none.json", 10.0)
