"""A node of real ROS 2, told what to do by lines of JSON. Runs where rclpy is, and not here.

It offers a service, an action and topics of its own from the start.
"""

import json
import sys
import threading
import time
from importlib import import_module

import rclpy
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from test_msgs.action import Fibonacci
from test_msgs.srv import BasicTypes

BEAT_S = 0.05
REFUSED, BROKEN = -1, 13


def plain(value):
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, (bytes, bytearray)):
        return list(value)
    return [plain(one) for one in value]


def fill(message, values):
    for name, value in values.items():
        old = getattr(message, name)
        if isinstance(value, dict):
            fill(old, value)
        else:
            setattr(message, name, type(old)(value) if isinstance(old, float) else value)
    return message


def type_of(name):
    package, sort, short = name.split("/")
    return getattr(import_module(f"{package}.{sort}"), short)


class Peer:
    def __init__(self):
        self.node = rclpy.create_node("peer")
        self.group = ReentrantCallbackGroup()
        node, group = self.node, self.group
        node.create_service(BasicTypes, "their_echo", self.echo, callback_group=group)
        self.told = node.create_publisher(JointState, "their_joints", 10)
        self.echoed = node.create_publisher(JointState, "echoed_joints", 10)
        node.create_subscription(
            JointState, "our_joints", self.echoed.publish, 10, callback_group=group
        )
        node.create_timer(BEAT_S, self.tell, callback_group=group)
        self.server = ActionServer(
            node,
            Fibonacci,
            "their_fibonacci",
            self.count,
            goal_callback=lambda goal: (
                GoalResponse.REJECT if goal.order == REFUSED else GoalResponse.ACCEPT
            ),
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
            callback_group=group,
        )
        self.clients = {}

    def echo(self, request, response):
        for name in request.get_fields_and_field_types():
            setattr(response, name, getattr(request, name))
        response.string_value = f"{request.string_value}!"
        return response

    def tell(self):
        message = JointState(name=["base", "elbow"], position=[0.5, -1.25])
        message.header.frame_id = "table"
        self.told.publish(message)

    def count(self, handle):
        found = [0, 1]
        while len(found) <= handle.request.order:
            if handle.is_cancel_requested:
                handle.canceled()
                return Fibonacci.Result(sequence=found)
            found.append(found[-1] + found[-2])
            handle.publish_feedback(Fibonacci.Feedback(sequence=found))
            time.sleep(BEAT_S)
        if handle.request.order == BROKEN:
            handle.abort()
        else:
            handle.succeed()
        return Fibonacci.Result(sequence=found)

    def do_call(self, *, service, type, request, wait_s=20.0):
        client = self.client(service, lambda: self.node.create_client(type_of(type), service))
        if not client.wait_for_service(wait_s):
            return {"problem": "nobody serves"}
        future = client.call_async(fill(type_of(type).Request(), request))
        return self.await_(future, wait_s)

    def do_parameters(self, *, node, names, wait_s=20.0):
        from rclpy.parameter_client import AsyncParameterClient

        client = self.client(node, lambda: AsyncParameterClient(self.node, node))
        if not client.wait_for_services(wait_s):
            return {"problem": "nobody serves"}
        listed = self.await_(client.list_parameters(), wait_s)
        values = self.await_(client.get_parameters(names), wait_s)
        described = self.await_(client.describe_parameters(names), wait_s)
        changed = self.await_(client.set_parameters([rclpy.Parameter(names[0], value=7.0)]), wait_s)
        return {"listed": listed, "values": values, "described": described, "changed": changed}

    def client(self, name, make):
        if name not in self.clients:
            self.clients[name] = make()
        return self.clients[name]

    def do_goal(self, *, action, type, goal, cancel_after=0, wait_s=20.0):
        kind = type_of(type)
        client = self.client(action, lambda: ActionClient(self.node, kind, action))
        if not client.wait_for_server(wait_s):
            return {"problem": "nobody serves"}
        heard, enough = [], threading.Event()

        def take(message):
            heard.append(plain(message.feedback))
            if cancel_after and len(heard) >= cancel_after:
                enough.set()

        sent = client.send_goal_async(fill(kind.Goal(), goal), feedback_callback=take)
        handle = self.wait(sent, wait_s)
        if handle is None or not handle.accepted:
            return {"accepted": False}
        canceled = None
        if cancel_after and enough.wait(wait_s):
            canceled = self.await_(handle.cancel_goal_async(), wait_s)
        ended = self.wait(handle.get_result_async(), wait_s)
        return {
            "accepted": True,
            "feedback": heard,
            "canceled": canceled,
            "status": ended.status,
            "result": plain(ended.result),
        }

    def do_listen(self, *, topic, type, count, lasting=False, wait_s=20.0):
        found, done = [], threading.Event()

        def take(message):
            if not done.is_set():
                found.append([time.time(), plain(message)])
            if len(found) >= count:
                done.set()

        qos = QoSProfile(
            depth=100,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if lasting else DurabilityPolicy.VOLATILE,
        )
        # What is destroyed while the executor waits on it ends the executor: it stays.
        self.node.create_subscription(type_of(type), topic, take, qos, callback_group=self.group)
        done.wait(wait_s)
        done.set()
        return {"found": found}

    def do_say(self, *, topic, type, value, count):
        # What is destroyed while the executor waits on it ends the executor: it stays.
        telling = self.clients.setdefault(
            topic, self.node.create_publisher(type_of(type), topic, 10)
        )
        for _ in range(count):
            telling.publish(fill(type_of(type)(), value))
            time.sleep(BEAT_S)
        return {"told": count}

    def do_graph(self):
        return {
            "nodes": [list(one) for one in self.node.get_node_names_and_namespaces()],
            "topics": dict(self.node.get_topic_names_and_types()),
            "services": dict(self.node.get_service_names_and_types()),
        }

    def await_(self, future, wait_s):
        found = self.wait(future, wait_s)
        return {"problem": "no answer"} if found is None else plain(found)

    def wait(self, future, wait_s):
        end_s = time.monotonic() + wait_s
        while not future.done() and time.monotonic() < end_s:
            time.sleep(0.002)
        return future.result() if future.done() else None


def main():
    rclpy.init()
    peer = Peer()
    executor = MultiThreadedExecutor(4)
    executor.add_node(peer.node)
    threading.Thread(target=executor.spin, daemon=True).start()
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        asked = json.loads(line)
        number = asked.pop("number")
        found = getattr(peer, f"do_{asked.pop('do')}")(**asked)
        print(json.dumps({"number": number, **found}), flush=True)


if __name__ == "__main__":
    main()
