"""A real node is a device: what it tells, answers and carries out."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from drivers.base import DeviceStoppedError
from drivers.load import call_action, read_status, read_statuses
from drivers.transports.ros2.transport import Ros2Transport
from drivers.transports.urls import make_transport
from drivers.virtual.ros2_node import Ros2Node
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    PreconditionError,
    RejectedError,
    UnreachableError,
)
from tests.fixtures.running import ROOT
from tests.ros2.conftest import PEER_TYPES, SHARE, Peer

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

ECHO, FIBONACCI = PEER_TYPES


def config(**changes: Any) -> dict[str, Any]:  # noqa: ANN401 - any setting
    texts = {
        name: SHARE.joinpath(f"{name}.{name.split('/')[1]}").read_text() for name in PEER_TYPES
    }
    return {
        "definitions": texts,
        "topics": {
            "joints": "their_joints sensor_msgs/msg/JointState position",
            "frame": "/their_joints sensor_msgs/msg/JointState header.frame_id",
        },
        "services": {"echo": f"their_echo {ECHO}"},
        "goals": {"count": f"their_fibonacci {FIBONACCI}"},
        "answer_limit_s": 40.0,
    } | changes


def a_node(domain: int, **changes: Any) -> Ros2Node:  # noqa: ANN401 - any setting
    transport = make_transport(f"ros2://127.0.0.1?domain={domain}")
    assert isinstance(transport, Ros2Transport)
    return Ros2Node(transport, config(**changes))


@pytest.fixture
def node(peer: Peer, domain: int) -> Iterator[Ros2Node]:
    found = a_node(domain)
    found.connect()
    yield found
    found.close()


def test_what_a_node_tells_is_what_the_device_tells(node: Ros2Node) -> None:
    assert read_statuses(node) == {
        "values": {"joints": [0.5, -1.25], "frame": "table"},
        "feedback": {},
        "is_present": True,
    }


def test_a_goal_is_carried_out_and_tells_how_far_it_is(node: Ros2Node) -> None:
    seen: list[Any] = []
    node.transport.observer = lambda direction, data: seen.append((direction, data))
    report = call_action(node, "run_goal", {"goal": "count", "arguments": {"order": 6}})
    assert report.evidence["result"] == {"sequence": [0, 1, 1, 2, 3, 5, 8]}
    assert len(read_status(node, "feedback")["sequence"]) > 2
    assert ("out", b'["/their_fibonacci", {"order": 6}]') in seen


def test_a_stop_cancels_the_goal(node: Ros2Node) -> None:
    stopping = threading.Timer(0.5, node.stop)
    stopping.start()
    with pytest.raises(DeviceStoppedError) as caught:
        call_action(node, "run_goal", {"goal": "count", "arguments": {"order": 5000}})
    stopping.join()
    assert caught.value.effect == "unknown"
    assert 1 < len(caught.value.context["result"]["sequence"]) < 5000
    node.clear_stop()
    call_action(node, "run_goal", {"goal": "count", "arguments": {"order": 2}})


def test_a_goal_that_is_refused_moves_nothing(node: Ros2Node) -> None:
    with pytest.raises(RejectedError) as caught:
        call_action(node, "run_goal", {"goal": "count", "arguments": {"order": -1}})
    assert caught.value.effect == "none"


def test_a_goal_that_the_node_aborts_has_an_unknown_effect(node: Ros2Node) -> None:
    with pytest.raises(DeviceError) as caught:
        call_action(node, "run_goal", {"goal": "count", "arguments": {"order": 13}})
    assert caught.value.effect == "unknown"


def test_a_goal_that_takes_too_long_is_cancelled_and_unknown(peer: Peer, domain: int) -> None:
    node = a_node(domain, goal_limit_s=0.5)
    node.connect()
    with pytest.raises(DeviceTimeoutError) as caught:
        call_action(node, "run_goal", {"goal": "count", "arguments": {"order": 5000}})
    assert caught.value.effect == "unknown"
    node.close()


def test_a_service_is_called(node: Ros2Node) -> None:
    arguments = {"int32_value": -4, "string_value": "x"}
    report = call_action(node, "call", {"service": "echo", "arguments": arguments})
    assert report.evidence["answer"]["string_value"] == "x!"
    assert report.evidence["answer"]["int32_value"] == -4


@pytest.mark.parametrize(
    "arguments", [{"goal": "other", "arguments": {}}, {"goal": "count", "arguments": {"ordre": 1}}]
)
def test_what_is_not_listed_or_does_not_fit_is_not_sent(
    node: Ros2Node, arguments: dict[str, Any]
) -> None:
    with pytest.raises(PreconditionError):
        call_action(node, "run_goal", arguments)


def test_a_node_that_is_not_there_is_unreachable(peer: Peer, domain: int) -> None:
    node = a_node(domain, topics={"x": "/nobody std_msgs/msg/Bool"}, answer_limit_s=0.5)
    with pytest.raises(UnreachableError) as caught:
        node.connect()
    assert caught.value.effect == "none"
    assert "x" in caught.value.message


def test_a_confined_line_speaks_ros(peer: Peer, domain: int) -> None:
    script = f"""
import sys
from drivers.transports.urls import make_transport
from drivers.virtual.ros2_node import Ros2Node
from workers.sandbox.address_bounds import segments_of
from workers.sandbox.confinement import Bounds, confine, is_possible
if not is_possible():
    print("UNCONFINED")
    sys.exit()
import importlib
importlib.import_module("drivers.transports.ros2.bus")
url = "ros2://127.0.0.1?domain={domain}"
confine(Bounds(segments=segments_of([url]), has_interfaces=True))
node = Ros2Node(make_transport(url), {config()!r})
node.connect()
print(node.run_goal("count", {{"order": 5}}).evidence["result"]["sequence"])
try:
    open("/etc/passwd")
except PermissionError:
    print("CONFINED")
"""
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    if done.stdout.strip() == "UNCONFINED":
        pytest.skip("this kernel cannot confine")
    assert done.stdout.split("\n")[:2] == ["[0, 1, 1, 2, 3, 5]", "CONFINED"], done.stderr[-3000:]
