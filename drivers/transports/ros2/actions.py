"""Actions of ROS 2: goal, feedback, result, cancel; both ends.

Source:
    ROS 2 design article "Actions"; states from action_msgs/msg/GoalStatus, codes from
    action_msgs/srv/CancelGoal.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

from drivers.transports.ros2.bus import Bus, Pending, Plain, Reply
from drivers.transports.ros2.message_definitions import ActionDefinition
from drivers.transports.ros2.ros_names import action_names, check_name
from labweb.domain.errors import DeviceTimeoutError, FrameError, RejectedError

CANCEL_GOAL = "action_msgs/srv/CancelGoal"
STATUSES = "action_msgs/msg/GoalStatusArray"
RESULT_KEPT_S = 900.0
"""How long a result is at hand after the end, as rcl has it."""

MOST_GOALS = 256
_ID_BYTES = 16
_NOBODY = bytes(_ID_BYTES)


class GoalState(IntEnum):
    """State of a goal."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    @property
    def is_final(self) -> bool:
        """Say whether it stays so."""
        return self >= GoalState.SUCCEEDED


class _CancelCode(IntEnum):
    NONE = 0
    REJECTED = 1
    UNKNOWN_GOAL = 2
    TERMINATED = 3


@dataclass(slots=True)
class Goal:
    """A goal that somebody sent us."""

    id: bytes
    value: Plain
    stamp: Plain
    state: GoalState = GoalState.ACCEPTED
    result: Plain = field(default_factory=dict)
    ended_s: float = 0.0
    waiting: list[Reply] = field(default_factory=list)


Decide = Callable[[bool], None]


class ActionServer:
    """Offers one action. Its owner decides and acts; this keeps the books."""

    def __init__(
        self,
        bus: Bus,
        name: str,
        action: ActionDefinition,
        *,
        taken: Callable[[Goal, Decide], None],
        cancel: Callable[[Goal], bool],
    ) -> None:
        """Offer it.

        Args:
            bus: Where.
            name: Full name of the action.
            action: Its type.
            taken: Told of each goal; calls what it is given once, now or later, to accept it
                or not. May not wait.
            cancel: Asked whether a goal that runs will be cancelled. May not wait.

        Raises:
            DefinitionError: The name is none.
        """
        names = action_names(check_name(name))
        self._action = action
        self._taken, self._cancel = taken, cancel
        self._goals: dict[bytes, Goal] = {}
        self._lock = threading.RLock()
        self._feedback = bus.publisher(names.feedback, action.feedback_message)
        self._statuses = bus.publisher(names.status, STATUSES, is_lasting=True)
        bus.serve(names.send_goal, action.send_goal, self._take)
        bus.serve(names.get_result, action.get_result, self._take_result_request)
        bus.serve(names.cancel_goal, bus.types.definitions.service(CANCEL_GOAL), self._take_cancel)

    def tell(self, goal: Goal, feedback: Mapping[str, Any]) -> None:
        """Tell how far a goal has come.

        Raises:
            DefinitionError: It is no such message.
        """
        self._feedback.publish({"goal_id": _uuid(goal.id), "feedback": feedback})

    def move(self, goal: Goal, state: GoalState, result: Mapping[str, Any] | None = None) -> None:
        """Take a goal to another state; a final one has a result and answers who waits.

        Raises:
            DefinitionError: It is no such result.
        """
        with self._lock:
            if goal.state.is_final:
                return
            goal.state = state
            waiting: list[Reply] = []
            if state.is_final:
                goal.result, goal.ended_s = dict(result or {}), time.monotonic()
                waiting, goal.waiting = goal.waiting, []
            self._tell_statuses()
        for reply in waiting:
            reply(_answer(goal))

    def _take(self, request: Plain, reply: Reply) -> None:
        """Take a goal in; one whose id was used is refused, for it may have been carried out."""
        now_s = time.time()
        stamp = {"sec": int(now_s), "nanosec": int(now_s % 1 * 1e9)}
        goal = Goal(_id(request["goal_id"]), request["goal"], stamp)
        with self._lock:
            self._forget_old()
            is_new = goal.id not in self._goals and len(self._goals) < MOST_GOALS
            if is_new:
                self._goals[goal.id] = goal
        if not is_new:
            reply({"accepted": False, "stamp": stamp})
            return

        def decide(is_accepted: bool) -> None:  # noqa: FBT001 - the one thing that is decided
            if not is_accepted:
                with self._lock:
                    self._goals.pop(goal.id, None)
            reply({"accepted": is_accepted, "stamp": stamp})
            with self._lock:
                self._tell_statuses()

        self._taken(goal, decide)

    def _take_result_request(self, request: Plain, reply: Reply) -> None:
        with self._lock:
            goal = self._goals.get(_id(request["goal_id"]))
            if goal is not None and not goal.state.is_final:
                goal.waiting.append(reply)
                return
        reply({"status": int(GoalState.UNKNOWN)} if goal is None else _answer(goal))

    def _take_cancel(self, request: Plain, reply: Reply) -> None:
        asked = request["goal_info"]
        wanted_id, stamp = _id(asked["goal_id"]), _moment(asked["stamp"])
        with self._lock:
            goals = list(self._goals.values())
        chosen = [
            goal
            for goal in goals
            if goal.id == wanted_id
            or (stamp and _moment(goal.stamp) <= stamp)
            or (wanted_id == _NOBODY and not stamp)
        ]
        running = [goal for goal in chosen if not goal.state.is_final]
        going = [goal for goal in running if self._cancel(goal)]
        for goal in going:
            self.move(goal, GoalState.CANCELING)
        code = _CancelCode.NONE if going else _CancelCode.REJECTED
        if not chosen and wanted_id != _NOBODY:
            code = _CancelCode.UNKNOWN_GOAL
        elif chosen and not running:
            code = _CancelCode.TERMINATED
        infos = [{"goal_id": _uuid(goal.id), "stamp": goal.stamp} for goal in going]
        reply({"return_code": int(code), "goals_canceling": infos})

    def _forget_old(self) -> None:
        limit_s = time.monotonic() - RESULT_KEPT_S
        old = [g.id for g in self._goals.values() if g.state.is_final and g.ended_s < limit_s]
        for goal_id in old:
            del self._goals[goal_id]

    def _tell_statuses(self) -> None:
        told = [
            {
                "goal_info": {"goal_id": _uuid(goal.id), "stamp": goal.stamp},
                "status": int(goal.state),
            }
            for goal in self._goals.values()
        ]
        self._statuses.publish({"status_list": told})


class ActionClient:
    """Sends goals to one action of another node."""

    def __init__(self, bus: Bus, name: str, action: ActionDefinition) -> None:
        """Look for the action; nothing is sent.

        Raises:
            DefinitionError: The name is none.
        """
        names = action_names(check_name(name))
        self._name = name
        self._send = bus.client(names.send_goal, action.send_goal)
        self._result = bus.client(names.get_result, action.get_result)
        self._cancel = bus.client(names.cancel_goal, bus.types.definitions.service(CANCEL_GOAL))
        self._heard: dict[bytes, Callable[[Plain], None]] = {}
        bus.subscribe(names.feedback, action.feedback_message, self._take_feedback)

    def wait(self, timeout_s: float) -> None:
        """Wait until somebody offers the action.

        Raises:
            UnreachableError: Nobody does; nothing was sent.
        """
        for client in (self._send, self._result, self._cancel):
            client.wait(timeout_s)

    @property
    def is_served(self) -> bool:
        """Say whether somebody offers the action."""
        return all(one.is_served for one in (self._send, self._result, self._cancel))

    def begin(
        self, value: Mapping[str, Any], heard: Callable[[Plain], None], timeout_s: float
    ) -> bytes:
        """Send a goal and return its id once it is accepted.

        Raises:
            DefinitionError, UnreachableError: Nothing was sent.
            RejectedError: It was not accepted; nothing moved.
            DeviceTimeoutError: No word whether it was; the effect is unknown.
        """
        goal_id = secrets.token_bytes(_ID_BYTES)
        self._heard[goal_id] = heard
        try:
            answer = self._send.call({"goal_id": _uuid(goal_id), "goal": value}, timeout_s)
        except BaseException:
            self.forget(goal_id)
            raise
        if not answer["accepted"]:
            self.forget(goal_id)
            raise RejectedError(f"{self._name} does not accept the goal")
        return goal_id

    def await_result(
        self, goal_id: bytes, timeout_s: float, pause: Callable[[Pending], Plain | None]
    ) -> tuple[GoalState, Plain]:
        """Wait for the end of a goal; `pause` waits for a while and may raise.

        Raises:
            DeviceTimeoutError: It did not end in time; it may go on.
            FrameError: Its end cannot be read.
        """
        deadline_s = time.monotonic() + timeout_s
        try:
            with self._result.begin({"goal_id": _uuid(goal_id)}) as pending:
                answer = pause(pending)
                while answer is None:
                    if time.monotonic() > deadline_s:
                        text = f"{self._name} did not end within {timeout_s:g} s"
                        raise DeviceTimeoutError(text)
                    answer = pause(pending)
        finally:
            self.forget(goal_id)
        if answer["status"] not in set(GoalState):
            raise FrameError(f"{self._name} ended in state {answer['status']}")
        return GoalState(answer["status"]), answer["result"]

    def cancel(self, goal_id: bytes, timeout_s: float) -> bool:
        """Ask to cancel a goal; False: it has ended, or is not cancelled.

        Raises:
            UnreachableError, DeviceTimeoutError: Nobody answered; it may go on.
        """
        info = {"goal_id": _uuid(goal_id)}
        answer = self._cancel.call({"goal_info": info}, timeout_s)
        return bool(answer["return_code"] == _CancelCode.NONE)

    def cancel_all(self, timeout_s: float) -> None:
        """Ask to cancel every goal of the action, whoever sent it.

        Raises:
            UnreachableError, DeviceTimeoutError: Nobody answered; they may go on.

        Source:
            action_msgs/srv/CancelGoal: goal id and time stamp are zero.
        """
        self.cancel(_NOBODY, timeout_s)

    def forget(self, goal_id: bytes) -> None:
        """Listen no more to what a goal tells."""
        self._heard.pop(goal_id, None)

    def _take_feedback(self, message: Plain) -> None:
        heard = self._heard.get(_id(message["goal_id"]))
        if heard is not None:
            heard(message["feedback"])


def _uuid(goal_id: bytes) -> Plain:
    return {"uuid": list(goal_id)}


def _id(value: Plain) -> bytes:
    return bytes(value["uuid"])


def _moment(stamp: Plain) -> int:
    return int(stamp["sec"]) * 10**9 + int(stamp["nanosec"])


def _answer(goal: Goal) -> Plain:
    return {"status": int(goal.state), "result": goal.result}
