"""Goals of ROS 2 nodes, as wishes to the server. Nothing here touches a device."""

from __future__ import annotations

import json
import logging
import threading
import time
from dataclasses import dataclass
from uuid import UUID

import msgspec

from drivers.transports.ros2.actions import ActionServer, Decide, Goal, GoalState
from drivers.transports.ros2.bus import Bus
from labweb.domain.enrollment.driver_spec import ActionSpec, check_arguments
from labweb.domain.errors import LabError
from labweb.domain.messages.action_asks import ActionAsk, AskTold, WithdrawAsk
from workers.base.valkey_store import ASKS, ASKS_TOLD, ValkeyStore
from workers.ros2.mapping import action_arguments
from workers.uplink.host_reports import BridgeWish

log = logging.getLogger(__name__)

ANSWER_S = 10.0
"""Longest time until the server has said whether it takes a wish."""

ACCEPTED, REFUSED = True, False
_ACTING = {"running", "completing", "complete"}


@dataclass(slots=True)
class _Open:
    goal: Goal
    server: ActionServer
    decide: Decide
    asked_s: float
    is_taken: bool = False
    is_withdrawn: bool = False


class Goals:
    """The wishes that wait, of all devices of one host."""

    def __init__(self, store: ValkeyStore, *, is_open: bool) -> None:
        self._store = store
        self._is_open = is_open
        self._lock = threading.RLock()
        self._waiting: dict[UUID, _Open] = {}

    def offer(self, bus: Bus, name: str, device_id: UUID, action: ActionSpec, kind: str) -> None:
        """Offer one action of one device.

        Raises:
            DefinitionError: Its name or its type is none.
        """
        server: ActionServer

        def taken(goal: Goal, decide: Decide) -> None:
            self._take(_Open(goal, server, decide, time.monotonic()), device_id, action)

        server = ActionServer(
            bus, name, bus.types.definitions.action(kind), taken=taken, cancel=self._cancel
        )

    def _take(self, wish: _Open, device_id: UUID, action: ActionSpec) -> None:
        """Send a wish on; what does not fit the action is refused here already."""
        try:
            args = action_arguments(action, wish.goal.value)
            problem = "; ".join(one.message for one in check_arguments(action, args))
        except ValueError as error:
            args, problem = {}, str(error)
        if not self._is_open:
            problem = "goals are switched off at this host"
        ask_id = UUID(bytes=wish.goal.id)
        ask = ActionAsk(
            epoch=0, ask_id=ask_id, device_id=device_id, action=action.name, args=args,
            source="ros2",
        )  # fmt: skip
        with self._lock:
            if not problem:
                self._waiting[ask_id] = wish
                problem = "" if self._put(ask) else "the host's Valkey is away"
            if problem:
                self._waiting.pop(ask_id, None)
        if problem:
            log.warning("a goal for %s is refused: %s", action.name, problem)
            wish.decide(REFUSED)

    def _put(self, frame: ActionAsk | WithdrawAsk) -> bool:
        return self._store.put_word(ASKS, msgspec.json.encode(BridgeWish(time.monotonic(), frame)))

    def _cancel(self, goal: Goal) -> bool:
        ask_id = UUID(bytes=goal.id)
        with self._lock:
            wish = self._waiting.get(ask_id)
            if wish is None or not self._put(WithdrawAsk(epoch=0, ask_id=ask_id)):
                return False
            wish.is_withdrawn = True
            return True

    def look(self) -> None:
        """Hand on what the server says, and give up what it has not answered."""
        for text in self._store.take_words(ASKS_TOLD):
            told = msgspec.json.decode(text, type=AskTold)
            with self._lock:
                wish = self._waiting.get(told.ask_id)
                if wish is not None and told.is_final:
                    del self._waiting[told.ask_id]
            if wish is None:
                if not told.is_final:
                    self._put(WithdrawAsk(epoch=0, ask_id=told.ask_id))
                continue
            try:
                _tell(wish, told)
            except LabError as error:
                log.warning("a goal cannot be told: %s", error)
        self._give_up()

    def _give_up(self) -> None:
        limit_s = time.monotonic() - ANSWER_S
        with self._lock:
            late = [
                ask_id
                for ask_id, wish in self._waiting.items()
                if not wish.is_taken and wish.asked_s < limit_s
            ]
            wishes = [self._waiting.pop(ask_id) for ask_id in late]
        for ask_id, wish in zip(late, wishes, strict=True):
            log.warning("the server says nothing of a goal: it is refused and withdrawn")
            self._put(WithdrawAsk(epoch=0, ask_id=ask_id))
            wish.decide(REFUSED)


def _tell(wish: _Open, told: AskTold) -> None:
    if told.state == "refused":
        log.warning("the server refuses a goal: %s", told.message)
        if not wish.is_taken:
            wish.decide(REFUSED)
            return
    if not wish.is_taken:
        wish.is_taken = True
        wish.decide(ACCEPTED)
    goal, server = wish.goal, wish.server
    if told.is_final:
        is_done = told.state == "complete"
        ended = GoalState.CANCELED if wish.is_withdrawn else GoalState.ABORTED
        result = {
            "state": told.state,
            "message": told.message,
            "run_number": told.run_number,
            "evidence": json.dumps(told.evidence, ensure_ascii=False, sort_keys=True),
        }
        server.move(goal, GoalState.SUCCEEDED if is_done else ended, result)
        return
    if told.state in _ACTING and goal.state is GoalState.ACCEPTED:
        server.move(goal, GoalState.EXECUTING)
    server.tell(goal, {"state": told.state, "message": told.message})
