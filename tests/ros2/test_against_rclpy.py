"""Topics, services and actions with real rclpy at the other end, both ways."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from drivers.transports.ros2.actions import ActionClient, ActionServer, Decide, Goal, GoalState
from drivers.transports.ros2.bus import Bus, Pending, Plain, Reply
from drivers.transports.ros2.link import LinkSettings
from drivers.transports.ros2.types import Types
from labweb.domain.errors import DeviceTimeoutError, RejectedError, UnreachableError
from tests.ros2.conftest import Peer

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

WAIT_S = 40.0
ECHO, FIBONACCI = "test_msgs/srv/BasicTypes", "test_msgs/action/Fibonacci"
JOINTS = "sensor_msgs/msg/JointState"


def until(is_true: Callable[[], Any]) -> None:
    deadline_s = time.monotonic() + WAIT_S
    while not is_true():
        assert time.monotonic() < deadline_s, "it did not come about"
        time.sleep(0.02)


def test_a_nested_message_comes_from_a_real_node(peer: Peer, bus: Bus) -> None:
    heard: list[Plain] = []
    bus.subscribe("/their_joints", JOINTS, heard.append)
    until(lambda: heard)
    assert heard[0]["name"] == ["base", "elbow"]
    assert heard[0]["position"] == [0.5, -1.25]
    assert heard[0]["header"]["frame_id"] == "table"


def test_a_nested_message_goes_to_a_real_node_and_comes_back_the_same(peer: Peer, bus: Bus) -> None:
    told = {
        "header": {"stamp": {"sec": 17, "nanosec": 999_999_999}, "frame_id": "µ-Labor"},
        "name": ["a", "bb", "ccc"],
        "position": [1e-300, -2.5, 1e300],
        "velocity": [],
        "effort": [0.0],
    }
    heard: list[Plain] = []
    bus.subscribe("/echoed_joints", JOINTS, heard.append)
    publisher = bus.publisher("/our_joints", JOINTS)
    until(lambda: publisher.listener_count)

    def tell() -> bool:
        publisher.publish(told)
        time.sleep(0.05)
        return bool(heard)

    until(tell)
    assert heard[0] == told


@pytest.fixture(scope="module")
def served(bus: Bus) -> list[Plain]:
    """Offer an echo, which answers late what asks for it."""
    asked: list[Plain] = []

    def answer(request: Plain, reply: Reply) -> None:
        asked.append(request)
        told = request | {"string_value": request["string_value"] + "?"}
        if request["string_value"] == "later":
            threading.Timer(0.3, reply, (told,)).start()
        else:
            reply(told)

    bus.serve("/our_echo", bus.types.definitions.service(ECHO), answer)
    return asked


def test_a_real_client_calls_our_service(peer: Peer, served: list[Plain]) -> None:
    request = {"bool_value": True, "float64_value": -0.1, "uint64_value": 2**64 - 1}
    for text in ("one", "later", "drei ß"):
        found = peer.ask(
            "call", service="/our_echo", type=ECHO, request=request | {"string_value": text}
        )
        assert found["string_value"] == text + "?"
        assert found["uint64_value"] == 2**64 - 1
        assert found["float64_value"] == -0.1
    assert [one["string_value"] for one in served[-3:]] == ["one", "later", "drei ß"]


def test_we_call_the_service_of_a_real_node(peer: Peer, bus: Bus) -> None:
    client = bus.client("/their_echo", bus.types.definitions.service(ECHO))
    client.wait(WAIT_S)
    for number in range(20):
        found = client.call({"int64_value": -number, "string_value": f"n{number}"}, WAIT_S)
        assert (found["int64_value"], found["string_value"]) == (-number, f"n{number}!")


def test_nothing_is_sent_to_a_service_that_nobody_offers(peer: Peer, bus: Bus) -> None:
    client = bus.client("/nobody", bus.types.definitions.service(ECHO))
    with pytest.raises(UnreachableError) as caught:
        client.call({}, 0.1)
    assert caught.value.effect == "none"


@pytest.fixture
def fibonacci(peer: Peer, bus: Bus) -> ActionClient:
    client = ActionClient(bus, "/their_fibonacci", bus.types.definitions.action(FIBONACCI))
    client.wait(WAIT_S)
    return client


def slowly(pending: Pending) -> Plain | None:
    return pending.wait(0.1)


def test_a_real_node_carries_out_our_goal_and_tells_how_far_it_is(fibonacci: ActionClient) -> None:
    heard: list[Plain] = []
    goal_id = fibonacci.begin({"order": 8}, heard.append, WAIT_S)
    state, result = fibonacci.await_result(goal_id, WAIT_S, slowly)
    assert state is GoalState.SUCCEEDED
    assert result["sequence"] == [0, 1, 1, 2, 3, 5, 8, 13, 21]
    assert len(heard) >= 3
    assert heard[-1]["sequence"] == result["sequence"][: len(heard[-1]["sequence"])]


def test_our_goal_is_cancelled_by_a_real_node(fibonacci: ActionClient) -> None:
    heard: list[Plain] = []
    goal_id = fibonacci.begin({"order": 1000}, heard.append, WAIT_S)
    until(lambda: len(heard) >= 2)
    assert fibonacci.cancel(goal_id, WAIT_S)
    state, result = fibonacci.await_result(goal_id, WAIT_S, slowly)
    assert state is GoalState.CANCELED
    assert 3 < len(result["sequence"]) < 1000
    assert not fibonacci.cancel(goal_id, WAIT_S)


def test_a_goal_that_a_real_node_refuses_moves_nothing(fibonacci: ActionClient) -> None:
    with pytest.raises(RejectedError) as caught:
        fibonacci.begin({"order": -1}, lambda _: None, WAIT_S)
    assert caught.value.effect == "none"


def test_a_goal_that_a_real_node_aborts_is_told_as_such(fibonacci: ActionClient) -> None:
    goal_id = fibonacci.begin({"order": 13}, lambda _: None, WAIT_S)
    assert fibonacci.await_result(goal_id, WAIT_S, slowly)[0] is GoalState.ABORTED


def test_a_goal_that_does_not_end_in_time_has_an_unknown_effect(fibonacci: ActionClient) -> None:
    goal_id = fibonacci.begin({"order": 60}, lambda _: None, WAIT_S)
    with pytest.raises(DeviceTimeoutError) as caught:
        fibonacci.await_result(goal_id, 0.2, slowly)
    assert caught.value.effect == "unknown"
    assert fibonacci.cancel(goal_id, WAIT_S)


class Counter:
    """Carries out goals as our end of the action."""

    def __init__(self, bus: Bus) -> None:
        self.canceled: set[bytes] = set()
        action = bus.types.definitions.action(FIBONACCI)
        self.server = ActionServer(
            bus, "/our_fibonacci", action, taken=self.take, cancel=self.cancel
        )

    def take(self, goal: Goal, decide: Decide) -> None:
        decide(goal.value["order"] >= 0)
        if goal.value["order"] >= 0:
            threading.Thread(target=self.count, args=(goal,), daemon=True).start()

    def cancel(self, goal: Goal) -> bool:
        self.canceled.add(goal.id)
        return True

    def count(self, goal: Goal) -> None:
        self.server.move(goal, GoalState.EXECUTING)
        found = [0, 1]
        while len(found) <= goal.value["order"]:
            if goal.id in self.canceled:
                self.server.move(goal, GoalState.CANCELED, {"sequence": found})
                return
            found.append(found[-1] + found[-2])
            self.server.tell(goal, {"sequence": found})
            time.sleep(0.05)
        self.server.move(goal, GoalState.SUCCEEDED, {"sequence": found})


@pytest.fixture(scope="module")
def counter(bus: Bus) -> Counter:
    return Counter(bus)


def test_we_carry_out_the_goal_of_a_real_node_and_tell_how_far_we_are(
    peer: Peer, counter: Counter
) -> None:
    found = peer.ask("goal", action="/our_fibonacci", type=FIBONACCI, goal={"order": 8})
    assert found["accepted"]
    assert found["status"] == GoalState.SUCCEEDED
    assert found["result"]["sequence"] == [0, 1, 1, 2, 3, 5, 8, 13, 21]
    assert len(found["feedback"]) >= 3


def test_a_real_node_cancels_its_goal(peer: Peer, counter: Counter) -> None:
    found = peer.ask(
        "goal", action="/our_fibonacci", type=FIBONACCI, goal={"order": 40}, cancel_after=3
    )
    assert found["canceled"]["return_code"] == 0
    assert found["status"] == GoalState.CANCELED
    assert 3 < len(found["result"]["sequence"]) < 41


def test_a_goal_of_a_real_node_is_refused(peer: Peer, counter: Counter) -> None:
    found = peer.ask("goal", action="/our_fibonacci", type=FIBONACCI, goal={"order": -5})
    assert found == {"accepted": False}


def test_real_ros_lists_our_node_topics_and_services(
    peer: Peer, bus: Bus, counter: Counter, served: list[Plain]
) -> None:
    bus.add_node("/", "bench")
    until(lambda: ["bench", "/"] in peer.ask("graph")["nodes"])
    graph = peer.ask("graph")
    assert graph["services"]["/our_echo"] == [ECHO]
    assert graph["services"]["/our_fibonacci/_action/send_goal"] == [f"{FIBONACCI}_SendGoal"]
    assert graph["topics"]["/our_fibonacci/_action/feedback"] == [f"{FIBONACCI}_FeedbackMessage"]


def test_who_leaves_is_forgotten_at_once_and_who_follows_is_heard(
    peer: Peer, types: Types, domain: int
) -> None:
    service = types.definitions.service(ECHO)

    def sees() -> tuple[bool, bool, bool]:
        graph = peer.ask("graph")
        names = ("/passing/joints" in graph["topics"], "/passing/unasked" in graph["services"])
        return *names, ["passing", "/"] in graph["nodes"]

    for count in range(4):
        ours = Bus(LinkSettings(domain=domain), types)
        ours.add_node("/", "passing")
        publisher = ours.publisher("/passing/joints", JOINTS)
        for name in ("/passing/unasked", "/passing/echo"):
            ours.serve(name, service, lambda request, reply: reply(request))
        asked = {"string_value": str(count)}
        found = peer.ask("call", service="/passing/echo", type=ECHO, request=asked)
        assert found.get("string_value") == str(count), found
        until(lambda: all(sees()))
        ours.close()
        left_s = time.monotonic()
        until(lambda: not any(sees()))
        assert time.monotonic() - left_s < 5.0, "it was forgotten only as its lease ran out"
        with pytest.raises(UnreachableError):
            publisher.publish({})
