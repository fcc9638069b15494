"""The thread on which a line works, and what another one does beside it: watch, and look ahead.

An action calls its driver on the line's own thread, which so need not hand it on and wait. The
thread that wanted the work waits for its end; twenty times a second it looks whether the action's
time is over or a person wants it to end, and while the line writes to its disk it reads and checks
the action that comes after the next one.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import TypeVar, cast

from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.runs.host_journal.journal_rows import ActionRow
from workers.base.signatures import is_signed

T = TypeVar("T")

LOOK_S = 0.05


class LineThread:
    """Does one piece of work after the other, while who asks for it watches."""

    def __init__(self) -> None:
        self._works: SimpleQueue[Callable[[], object] | None] | None = None
        self._told: SimpleQueue[Future[object] | _Ahead] = SimpleQueue()
        self._known: tuple[Signed, str] | None = None
        self.is_left = False
        """Nobody hears any more what the thread that worked last does."""

    def run(self, work: Callable[[], T], look: Callable[[], None]) -> T:
        """Do it on the thread, and return or raise what comes of it.

        Args:
            work: What is to be done.
            look: Is called here every `LOOK_S` meanwhile. What it raises is raised at once, as is
                whatever else is raised here meanwhile; the thread `is_left` to itself with what it
                does, and the next work has another one.
        """
        self._begin().put(work)
        try:
            end = self._wait(look)
        except BaseException:
            self._works, self.is_left = None, True
            raise
        return cast("T", end.result())

    def _begin(self) -> SimpleQueue[Callable[[], object] | None]:
        """Return where work is given to the thread, which is started first if there is none."""
        if self._works is None:
            works: SimpleQueue[Callable[[], object] | None] = SimpleQueue()
            told: SimpleQueue[Future[object] | _Ahead] = SimpleQueue()
            threading.Thread(target=_serve, args=(works, told), name="line", daemon=True).start()
            self._works, self._told, self.is_left = works, told, False
        return self._works

    def _wait(self, look: Callable[[], None]) -> Future[object]:
        """Wait for the end of the work; read ahead, and look, meanwhile."""
        due_s = time.monotonic() + LOOK_S
        while True:
            with suppress(Empty):
                told = self._told.get(timeout=LOOK_S)
                if isinstance(told, Future):
                    return told
                self._prepare(*told)
            if time.monotonic() >= due_s:
                due_s = time.monotonic() + LOOK_S
                look()

    def close(self) -> None:
        """End the thread after what it does now."""
        if self._works is not None:
            self._works.put(None)
            self._works = None

    def prepare(self, row: ActionRow, keys: Mapping[str, str]) -> None:
        """Have an action that comes soon read and its signature checked, where nobody waits."""
        self._told.put((row, keys))

    def is_signed(self, row: ActionRow, keys: Mapping[str, str]) -> bool:
        """Say whether a known key of the server signed exactly the text of an action.

        Whether one did depends on text, signature and key alone: what was prepared with the same
        three is not checked again.
        """
        return self._known == _mark(row, keys) or is_signed(row.signed, keys)

    def _prepare(self, row: ActionRow, keys: Mapping[str, str]) -> None:
        # What is wrong with it is found, and told, when its turn comes.
        with suppress(Exception):
            _ = row.operation  # reads the command, too; the row keeps both
            if is_signed(row.signed, keys):
                self._known = _mark(row, keys)


_Ahead = tuple[ActionRow, Mapping[str, str]]


def _mark(row: ActionRow, keys: Mapping[str, str]) -> tuple[Signed, str]:
    return row.signed, keys.get(row.key_id, "")


def _serve(
    works: SimpleQueue[Callable[[], object] | None], told: SimpleQueue[Future[object] | _Ahead]
) -> None:
    while (work := works.get()) is not None:
        end: Future[object] = Future()
        try:
            end.set_result(work())
        except BaseException as error:  # noqa: BLE001 - raised again where it was asked for
            end.set_exception(error)
        told.put(end)
