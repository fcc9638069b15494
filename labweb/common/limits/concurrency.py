"""Lanes: how many may use something of one kind at a time, in all and of one name.

Each lane has connections to the database of its own (`settings.LANES`), so that what is full in
one takes nothing from another. A request enters its lane before it gets a thread and a
connection; a socket asks the database on the threads of its lane.
"""

from __future__ import annotations

import asyncio
from collections import Counter, OrderedDict
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from threading import Lock
from typing import ParamSpec, TypeVar

from channels.db import database_sync_to_async
from django.conf import settings
from django.db import connection

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Room:
    """How much room a lane has."""

    most: int
    most_of_one: int
    """Of these for one name at a time."""

    waits_s: float = 0.0
    """How long one waits for a place before it is refused; 0: not at all."""

    most_waiting: int = 64
    most_waiting_of_one: int = 16


class FullError(Exception):
    """There is no place in the lane."""

    def __init__(self, *, is_own: bool) -> None:
        super().__init__("no place")
        self.is_own = is_own
        """It is the name's own share that is used up, and not the lane."""


class Lane:
    """The places of one lane, given in the order of asking. It belongs to one event loop."""

    def __init__(self, room: Room) -> None:
        self.room = room
        self._inside: Counter[str] = Counter()
        self._waiting: OrderedDict[asyncio.Future[None], str] = OrderedDict()

    async def enter(self, name: str) -> None:
        """Take a place, or wait for one; whoever has it calls `leave`.

        Raises:
            FullError: There was none in time, or too many wait.
        """
        if self._has_place_for(name):
            self._inside[name] += 1
            return
        is_own = self._is_at_own_end(name)
        own_waiting = sum(waiting == name for waiting in self._waiting.values())
        if not self.room.waits_s or own_waiting >= self.room.most_waiting_of_one:
            raise FullError(is_own=is_own or own_waiting >= self.room.most_waiting_of_one)
        if len(self._waiting) >= self.room.most_waiting:
            raise FullError(is_own=False)
        await self._wait(name)

    async def _wait(self, name: str) -> None:
        turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiting[turn] = name
        try:
            async with asyncio.timeout(self.room.waits_s):
                await turn
        except BaseException as error:
            self._waiting.pop(turn, None)
            if turn.done() and not turn.cancelled():
                self.leave(name)  # the place came together with the end of the patience
            if isinstance(error, TimeoutError):
                raise FullError(is_own=self._is_at_own_end(name)) from error
            raise

    def leave(self, name: str) -> None:
        """Give the place back; it goes to the first in the queue who may have it."""
        self._inside[name] -= 1
        if not self._inside[name]:
            del self._inside[name]
        for turn, waiting in list(self._waiting.items()):
            if not turn.done() and self._has_place_for(waiting):
                del self._waiting[turn]
                self._inside[waiting] += 1
                turn.set_result(None)
                return

    def _has_place_for(self, name: str) -> bool:
        return self._inside.total() < self.room.most and not self._is_at_own_end(name)

    def _is_at_own_end(self, name: str) -> bool:
        return self._inside[name] >= self.room.most_of_one


class LaneTicket:
    """A place that is held until its thread is through, whoever stops waiting for the answer.

    A request whose client has gone is given up by the event loop at once, while its thread goes
    on with its connection: the place is free when the thread is.
    """

    def __init__(self, lane: Lane, name: str) -> None:
        self._lane, self._name = lane, name
        self._loop = asyncio.get_running_loop()
        self._lock = Lock()
        self._is_begun = self._is_left = False

    def begin(self) -> bool:
        """Tell whether the thread may start; no more once the place was given back."""
        with self._lock:
            self._is_begun = not self._is_left
            return self._is_begun

    def end(self) -> None:
        """Give the place back, from the thread."""
        self._loop.call_soon_threadsafe(self._lane.leave, self._name)

    def drop(self) -> None:
        """Give the place back, from the event loop, if no thread has begun."""
        with self._lock:
            if self._is_begun or self._is_left:
                return
            self._is_left = True
        self._lane.leave(self._name)


def give_back_connection() -> None:
    """Give this thread's connection back, because something slow is waited for now.

    The next query takes one again. Inside of a transaction this does nothing: who waits for
    something slow begins none before.
    """
    if not connection.in_atomic_block:
        connection.close()


@cache
def _threads(lane: str) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(settings.LANES[lane], thread_name_prefix=f"lane-{lane}")


def on_lane(lane: str, function: Callable[P, T]) -> Callable[P, Awaitable[T]]:
    """Return what calls a function on a thread of that lane, for code of the event loop.

    As many run at a time as the lane has connections; each gives its own back after.
    """
    asked: Callable[P, Awaitable[T]] = database_sync_to_async(
        function, thread_sensitive=False, executor=_threads(lane)
    )
    return asked
