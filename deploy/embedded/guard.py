"""Stand above the supervisor, and end its processes if it is killed.

::

    terminal ──signals──▶ guard ──signals──▶ supervisor ──▶ web, edge host, PostgreSQL …

The kernel tells the supervisor's direct children when it dies, but not theirs: all of them
become children of the guard, which is their next reaper. If the guard is killed, the kernel
tells the supervisor, which then stops the lab. The two are in different sessions, so that no
single signal to a process or a group reaches both.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from time import monotonic
from types import FrameType

from deploy.embedded import procfs
from deploy.embedded.console import BROWSER_MARK

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_GRACE_S = 1.0
_KILL_WITHIN_S = 1.0
_SIGNALLED = 128
"""Added to a signal's number it gives the exit code that shells use."""


def guarded(work: Callable[[int], int]) -> int:
    """Do the work in a process of its own, and return its exit code.

    Call it before any thread is started. It returns twice: in the child with what the work
    returned, in the guard once the child has ended and nothing of it is left.

    Args:
        work: What the supervisor does; it is given the guard's process id.
    """
    guard = os.getpid()
    procfs.adopt_orphans()
    pid = os.fork()
    if pid == 0:
        os.setsid()
        on_stop_signals(_leave)
        procfs.die_with_parent(signal.SIGTERM)
        if os.getppid() != guard:
            return _SIGNALLED + signal.SIGKILL
        return work(guard)
    return _guard(pid)


def on_stop_signals(handler: Callable[[int, FrameType | None], None]) -> None:
    """Have a handler called for each signal that asks the lab to stop."""
    for number in STOP_SIGNALS:
        # nohup asks to outlive the terminal by ignoring this signal beforehand.
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


def _leave(number: int, frame: FrameType | None) -> None:
    """Leave before anything was started; the supervisor has a handler of its own."""
    del number, frame
    sys.exit(0)


def _guard(supervisor: int) -> int:
    def forward(number: int, frame: FrameType | None) -> None:
        del frame
        with suppress(ProcessLookupError):
            os.kill(supervisor, number)

    on_stop_signals(forward)
    code = os.waitstatus_to_exitcode(os.waitpid(supervisor, 0)[1])
    ended = _end_all()
    if code >= 0:
        return code
    sys.stderr.write(f"labweb: the supervisor was killed; ended the {ended} processes it left\n")
    return _SIGNALLED - code


def _end_all() -> int:
    """End every descendant, which after the supervisor's end are all children of this one."""
    left = _send_all(signal.SIGTERM)
    count = len(left)
    procfs.wait_gone(left, _GRACE_S)
    deadline = monotonic() + _KILL_WITHIN_S
    while (left := _send_all(signal.SIGKILL)) and monotonic() < deadline:
        procfs.wait_gone(left, 0.1)
    return count


def _send_all(number: signal.Signals) -> list[procfs.Identity]:
    found = procfs.family_without(os.getpid(), BROWSER_MARK)
    for process in found:
        procfs.send(process, number)
    return found
