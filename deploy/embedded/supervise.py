"""Keep processes running, and end all of them when it is time."""

from __future__ import annotations

import os
import select
import signal
import subprocess
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from types import FrameType

from deploy.embedded import children, procfs, room
from deploy.embedded.children import Process, StopOrder
from deploy.embedded.console import BROWSER_MARK, Console
from deploy.embedded.guard import on_stop_signals
from deploy.embedded.layout import CHECKOUT, Layout
from deploy.embedded.record import ProcessEntry, Record

FIRST_BACKOFF_S = 0.5
LONGEST_BACKOFF_S = 8.0
SETTLED_S = 30.0
"""A process that has run this long starts again without delay."""

EDGE_HOST_HEAD_START_S = 1.5
PROCESSES_BY_S = 3.0
BROKER_BY_S = 3.5
DATABASE_BY_S = 4.4
HURRIED_PACE = 0.3
_SERVER_LAST_WORD_S = 0.3
_ORPHANS_WITHIN_S = 1.0
_ROTATE_EVERY_S = 60.0


class StopRequestError(Exception):
    """A person or the system asked the lab to stop."""


@dataclass(slots=True)
class _Child:
    process: Process
    popen: subprocess.Popen[bytes]
    """Collected by `Supervisor._reap` alone, so its ``returncode`` tells the truth."""

    started_s: float
    is_once: bool = False
    backoff_s: float = 0.0
    restart_at_s: float | None = None
    is_told: bool = False
    """That it cannot run for want of room; it is said once."""


class Supervisor:
    """Parent of every process of a lab, and of every orphan among them."""

    def __init__(self, layout: Layout, record: Record, console: Console) -> None:
        """Take over the signals of this process; call it in the main thread."""
        self._layout = layout
        self._record = record
        self._console = console
        self._children: dict[str, _Child] = {}
        self._environment: Mapping[str, str] = {}
        self._is_stopping = False
        self._stop_asked = 0
        self._rotate_at_s = monotonic() + _ROTATE_EVERY_S
        procfs.adopt_orphans()
        self._wake_read, self._wake_write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        signal.set_wakeup_fd(self._wake_write, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, _wake_only)
        on_stop_signals(self._on_stop_signal)
        self._disk = room.Disk(layout.data, console)
        self._is_unrecorded = False
        self._save_record()

    def start(self, process: Process, environment: Mapping[str, str]) -> None:
        """Start a process and keep it running."""
        self._environment = environment
        self._children[process.name] = _Child(process, self._launch(process), monotonic())
        self._write_record()

    def exit_code(self, name: str) -> int | None:
        """Give how a process ended, or None while it runs."""
        return self._children[name].popen.returncode

    def run_stage(self, name: str, argv: tuple[str, ...], environment: Mapping[str, str]) -> int:
        """Run a program to its end and return its exit code."""
        self._environment = environment
        process = Process(name, argv)
        child = _Child(process, self._launch(process), monotonic(), is_once=True)
        self._children[name] = child
        self._write_record()
        while child.popen.returncode is None:
            self.pause(1.0)
        del self._children[name]
        self._write_record()
        return child.popen.returncode

    def watch(self, is_over: Callable[[], bool] = lambda: False) -> None:
        """Supervise until the condition holds.

        Raises:
            StopRequestError: A signal asked for the end.
        """
        while not is_over():
            self.pause(self._next_deadline_s() - monotonic())

    def pause(self, timeout_s: float) -> None:
        """Wait for a signal or the time, then do what is due.

        Raises:
            StopRequestError: A signal asked for the end.
        """
        self._sleep(timeout_s)
        if self._stop_asked and not self._is_stopping:
            raise StopRequestError
        self._reap()
        if self._disk.look():
            self._hurry()
        self._restart_due()
        self._rotate_due()
        if self._is_unrecorded and self._disk.was_looked_at:
            self._save_record()

    def wake(self) -> None:
        """End a pause early, from any thread."""
        with suppress(OSError):
            os.write(self._wake_write, b"\0")

    def log_of(self, name: str) -> Path:
        """Name the log of a process or stage."""
        return self._layout.logs / f"{name}.log"

    def stop(self) -> None:
        """End everything in order, within five seconds; a second signal ends it at once."""
        self._is_stopping = True
        self._stop_asked = 0
        # A killed guard means that somebody wants the lab gone: be quick about the same order.
        pace = 1.0 if self._record.is_running() else HURRIED_PACE
        began = monotonic()
        edge = self._running(StopOrder.EDGE_HOST)
        rest = self._running(StopOrder.OTHERS)
        self._ask(edge)
        self._await(edge, began + pace * EDGE_HOST_HEAD_START_S)
        self._ask(rest)
        self._await([*edge, *rest], began + pace * PROCESSES_BY_S)
        self._kill([*edge, *rest])
        self._end_orphans(0.2)
        for order, by_s in ((StopOrder.BROKER, BROKER_BY_S), (StopOrder.DATABASE, DATABASE_BY_S)):
            servers = self._running(order)
            self._ask(servers)
            self._await(servers, began + pace * by_s)
            self._kill(servers)
        self._end_orphans(0.0)
        signal.set_wakeup_fd(-1)

    def _spawn(self, child: _Child) -> None:
        try:
            popen = self._launch(child.process)
        except OSError as error:
            child.restart_at_s = monotonic() + LONGEST_BACKOFF_S
            if not child.is_told:
                child.is_told = True
                self._console.line(
                    f"{child.process.name} cannot be started: {error}; "
                    f"it is tried again every {LONGEST_BACKOFF_S:g} s, and when there is room"
                )
            return
        child.restart_at_s = None
        child.started_s, child.popen = monotonic(), popen
        self._write_record()

    def _launch(self, process: Process) -> subprocess.Popen[bytes]:
        log = self.log_of(process.name)
        return children.spawn(process, environment=self._environment, log=log, folder=CHECKOUT)

    def _write_record(self) -> None:
        self._record.processes = {}
        for name, child in self._children.items():
            if identity := children.identity_of(child.popen):
                self._record.processes[name] = ProcessEntry(identity, child.process.orphan_signal)
        self._save_record()

    def _save_record(self) -> None:
        """Write the record; what the disk refuses is written later, and ends no lab."""
        try:
            self._record.save(self._layout)
        except OSError as error:
            if not self._is_unrecorded:
                self._console.line(f"The list of processes cannot be written now: {error}")
            self._is_unrecorded = True
        else:
            if self._is_unrecorded:
                self._console.line("The list of processes is written again")
            self._is_unrecorded = False

    def _on_stop_signal(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._stop_asked += 1

    def _sleep(self, timeout_s: float) -> None:
        select.select([self._wake_read], [], [], max(0.0, timeout_s))
        with suppress(BlockingIOError):
            while os.read(self._wake_read, 512):
                pass

    def _reap(self) -> None:
        """Collect every ended process; what an ended child leaves behind is ended too."""
        while (pid := _ended_pid()) is not None:
            child = self._child_with(pid)
            if child is not None:
                # Before it is collected its group's number cannot belong to another.
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(pid, signal.SIGTERM)
                child.popen.wait()
                self._after_end(child, child.popen.returncode)
            else:
                with suppress(ChildProcessError):
                    os.waitpid(pid, os.WNOHANG)

    def _after_end(self, child: _Child, code: int) -> None:
        if child.is_once or self._is_stopping:
            return
        lasted_s = monotonic() - child.started_s
        fresh = lasted_s >= SETTLED_S or child.backoff_s == 0
        child.backoff_s = FIRST_BACKOFF_S if fresh else min(LONGEST_BACKOFF_S, 2 * child.backoff_s)
        has_room = self._disk.takes_restarts()
        if not has_room:
            child.backoff_s = LONGEST_BACKOFF_S
        child.restart_at_s = monotonic() + child.backoff_s
        with suppress(OSError):  # whoever cannot be found now is ended before the next start
            self._send_orphans(signal.SIGTERM)
        if not child.is_told:
            self._tell_end(child, code, lasted_s, has_room=has_room)
        child.is_told = not has_room

    def _tell_end(self, child: _Child, code: int, lasted_s: float, *, has_room: bool) -> None:
        log = self.log_of(child.process.name)
        said = children.last_lines(log) or ["(empty)"]
        when = f"starting it again in {child.backoff_s:g} s"
        if not has_room:
            when = (
                "it starts by itself once the disk has room, which is tried every "
                f"{child.backoff_s:g} s"
            )
        self._console.line(
            f"{child.process.name} ended with {children.describe_exit(code)} after "
            f"{lasted_s:.1f} s; {when}. {log}: {said[0]}"
        )

    def _hurry(self) -> None:
        """Start at once what ended for want of room."""
        for child in self._children.values():
            child.is_told = False
            if child.restart_at_s is not None:
                child.restart_at_s, child.backoff_s = monotonic(), 0.0

    def _restart_due(self) -> None:
        due = [
            child
            for child in self._children.values()
            if child.restart_at_s is not None and child.restart_at_s <= monotonic()
        ]
        if not due:
            return
        try:
            # What the ended process left must not act beside the one that replaces it.
            self._end_orphans(0.0)
        except OSError as error:  # no file is left to look with: nothing is started blindly
            for child in due:
                child.restart_at_s = monotonic() + FIRST_BACKOFF_S
            self._console.line(f"Nothing can be started now: {error}")
            return
        for child in due:
            self._spawn(child)

    def _rotate_due(self) -> None:
        if monotonic() >= self._rotate_at_s:
            self._rotate_at_s = monotonic() + _ROTATE_EVERY_S
            for log in self._layout.logs.glob("*.log"):
                children.rotate(log)

    def _next_deadline_s(self) -> float:
        restarts = (child.restart_at_s for child in self._children.values())
        fixed = (self._rotate_at_s, self._disk.look_at_s)
        return min([*fixed, *(at_s for at_s in restarts if at_s is not None)])

    def _child_with(self, pid: int) -> _Child | None:
        return next((child for child in self._children.values() if child.popen.pid == pid), None)

    def _running(self, order: StopOrder) -> list[_Child]:
        return [
            child
            for child in self._children.values()
            if child.process.stop_order == order and child.popen.returncode is None
        ]

    def _ask(self, asked: list[_Child]) -> None:
        for child in asked:
            _send_group(child, child.process.stop_signal)

    def _await(self, awaited: list[_Child], until_s: float) -> None:
        while any(child.popen.returncode is None for child in awaited):
            left_s = until_s - monotonic()
            if left_s <= 0 or self._stop_asked:
                return
            self._sleep(left_s)
            self._reap()

    def _kill(self, killed: list[_Child]) -> None:
        left = [child for child in killed if child.popen.returncode is None]
        if not left:
            return
        names = ", ".join(child.process.name for child in left)
        self._console.line(f"Ending {names} by force")
        if any(child.process.stop_order >= StopOrder.BROKER for child in left):
            # These keep their files in order when they are told before they are killed.
            for child in left:
                _send_group(child, child.process.orphan_signal)
            procfs.wait_gone(_identities(left), _SERVER_LAST_WORD_S)
        for child in left:
            _send_group(child, signal.SIGKILL)
        procfs.wait_gone(_identities(left), 1.0)
        self._reap()

    def _orphans(self) -> list[procfs.Identity]:
        """List what lost its parent to us, with all below it."""
        known = {child.popen.pid for child in self._children.values()}
        return procfs.family_without(os.getpid(), BROWSER_MARK, known)

    def _send_orphans(self, number: signal.Signals) -> list[procfs.Identity]:
        orphans = self._orphans()
        for process in orphans:
            procfs.send(process, number)
        return orphans

    def _end_orphans(self, grace_s: float) -> None:
        if grace_s:
            procfs.wait_gone(self._send_orphans(signal.SIGTERM), grace_s)
        deadline = monotonic() + _ORPHANS_WITHIN_S
        while (left := self._send_orphans(signal.SIGKILL)) and monotonic() < deadline:
            procfs.wait_gone(left, 0.1)
        self._reap()


def _wake_only(number: int, frame: FrameType | None) -> None:
    del number, frame


def _ended_pid() -> int | None:
    """Find a child that has ended, without collecting it."""
    try:
        result = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:
        return None
    return None if result is None else result.si_pid


def _send_group(child: _Child, number: signal.Signals) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child.popen.pid, number)


def _identities(group: list[_Child]) -> list[procfs.Identity]:
    found = (children.identity_of(child.popen) for child in group)
    return [process for process in found if process is not None]
