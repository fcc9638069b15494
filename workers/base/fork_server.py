"""A process that has imported all that a host's processes need, and forks them: in a moment.

To import Celery, transports and cryptography takes a processor seconds, to fork milliseconds. So a
line that ended, or whose driver is replaced, is back at once, and twenty lines share one copy of
the code in memory.

What is forked is the supervisor's child, not this one's: it is forked twice, and the supervisor
takes up orphans. So who ends, who is told of it and who dies with whom is as if the supervisor had
started it. The fork server holds no key, no journal and no socket but the supervisor's, and a
process lets go of that before anything of its own runs: a driver cannot ask for another process.

Source:
    fork(2); unix(7), SCM_RIGHTS; prctl(2), PR_SET_CHILD_SUBREAPER.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import gc
import logging
import os
import select
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from signal import SIG_IGN, SIGINT, SIGKILL, Signals, default_int_handler, signal
from typing import IO

import msgspec
from setproctitle import setproctitle

from workers.base.parent_death_signal import EXIT_ORPHAN, die_with_parent

log = logging.getLogger(__name__)

PR_SET_CHILD_SUBREAPER = 36
PATIENCE_S = 10.0
"""How long a fork may take, on a busy machine."""

LOOK_S = 0.1
READY_WITHIN_S = 120.0
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0
"""How long after a start it is started again, doubled each time until it was ready."""

MOST_BURIED_COUNT = 100
CODE_IS_LOST = 255
"""In the place of an exit code that somebody else has read."""

_ROOM = "." * 1024
"""Place for the titles of processes in the arguments of the fork server."""

_TITLES = {
    "SPT_NOENV": "1",  # a title written over the environment hides by which lab a process was begun
    "NOSETPS": "1",  # Celery would call every worker the same
}
MAX_WISH_BYTES = 64 * 1024
_PID = struct.Struct("=i")
_GO = b"."
_STDOUT = 1


class ForkRequest(msgspec.Struct, frozen=True):
    """What shall be started."""

    parent: int
    """Process id of the supervisor."""

    orphan_signal: int
    kind: str
    """Module of `workers` whose `main` it becomes."""

    argv: list[bytes]
    """As the system has them: a path need not be text."""


class Forked:
    """A process that was forked for this one, in the place of a `subprocess.Popen`."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return its exit code as `subprocess` gives it, and reap it; None: it runs."""
        return self.returncode if self.returncode is not None else self._wait(os.WNOHANG)

    def wait(self) -> None:
        """Wait for its end."""
        if self.poll() is None:
            self._wait(0)

    def send_signal(self, number: Signals) -> None:
        """Send it a signal, if it runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(SIGKILL)

    def _wait(self, options: int) -> int | None:
        try:
            pid, status = os.waitpid(self.pid, options)
        except ChildProcessError:
            self.returncode = CODE_IS_LOST
            return self.returncode
        if pid:
            self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode


class ForkServer:
    """The supervisor's end: starts the fork server, again if need be, and asks it."""

    def __init__(
        self,
        environment: Mapping[str, str],
        imports: Sequence[str],
        is_over: Callable[[], bool] = lambda: False,
    ) -> None:
        """Start nothing yet.

        Args:
            environment: What the processes are given.
            imports: Names of modules that it imports before it forks; none may start a thread.
            is_over: Says whether to wait for it no longer.
        """
        self._imports = tuple(imports)
        self._environment = dict(environment) | _TITLES
        self._is_over = is_over
        self._popen: subprocess.Popen[bytes] | None = None
        self._channel: socket.socket | None = None
        self._is_ready = False
        self._began_s = 0.0
        self._next_start_s = 0.0
        self._pause_s = FIRST_PAUSE_S

    def keep(self) -> None:
        """Start it unless it runs; it is ready some seconds later."""
        now_s = time.monotonic()
        if self._popen is not None and self._popen.poll() is None:
            if not self._can_fork() and now_s - self._began_s > READY_WITHIN_S:
                log.error("the fork server is not ready after %.0f s", READY_WITHIN_S)
                self.end()
            return
        if now_s < self._next_start_s:
            return
        if self._popen is not None:
            log.warning("the fork server ended with code %s", self._popen.returncode)
        self._close()
        self._began_s, self._next_start_s = now_s, now_s + self._pause_s
        self._pause_s = min(2 * self._pause_s, LONGEST_PAUSE_S)
        try:
            self._start()
        except OSError as error:
            log.error("the fork server cannot be started: %s", error)
            self._close()

    def _start(self) -> None:
        adopt_orphans()
        self._channel, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.settimeout(PATIENCE_S)
        argv = [
            sys.executable,
            "-m",
            "workers.base.parent_death_signal",
            str(os.getpid()),
            str(int(SIGKILL)),
        ]
        with there:
            self._popen = subprocess.Popen(
                [*argv, "call", __name__, str(there.fileno()), *self._imports, _ROOM],
                env=self._environment,
                stdin=subprocess.DEVNULL,
                pass_fds=[there.fileno()],
            )
        log.info("the fork server runs as process %d", self._popen.pid)

    def fork(
        self,
        orphan_signal: Signals,
        kind: str,
        argv: Sequence[str],
        output: IO[bytes] | None = None,
    ) -> Forked | None:
        """Start a process; None: nobody can be asked yet.

        Args:
            orphan_signal: What the kernel sends it when this process dies.
            kind: Module of `workers` whose `main` it becomes.
            argv: What that is called with.
            output: What becomes its standard output; None: that of this process.

        Raises:
            OSError: It did not come about, and nothing of it is left.
        """
        self.keep()
        if self._channel is None or not self._can_fork():
            return None
        wish = ForkRequest(os.getpid(), int(orphan_signal), kind, [*map(os.fsencode, argv)])
        near, far = socket.socketpair()
        with near:
            try:
                with far:
                    handles = [far.fileno(), *([] if output is None else [output.fileno()])]
                    socket.send_fds(self._channel, [msgspec.json.encode(wish)], handles)
                self._wait_for(near)
            except OSError:
                self.end()  # who does not take a wish, or hangs, is replaced
                raise
            # Until it has the word to go, it ends when this end is closed.
            told = near.recv(_PID.size)
            if len(told) != _PID.size:
                raise OSError(errno.EAGAIN, "the fork server could not fork")
            near.sendall(_GO)
        (pid,) = _PID.unpack(told)
        return Forked(pid)

    def pids(self) -> set[int]:
        """Return its process id, if it was started."""
        return set() if self._popen is None else {self._popen.pid}

    def end(self) -> None:
        """End it; what it has forked goes on."""
        if self._popen is not None:
            self._popen.kill()
            self._popen.wait()
        self._close()

    def _can_fork(self) -> bool:
        if not self._is_ready and self._channel and select.select([self._channel], [], [], 0.0)[0]:
            with contextlib.suppress(OSError):
                self._is_ready = self._channel.recv(1) == _GO
            if self._is_ready:
                self._pause_s = FIRST_PAUSE_S
                log.info("the fork server is ready after %.1f s", time.monotonic() - self._began_s)
        return self._is_ready

    def _wait_for(self, near: socket.socket) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not select.select([near], [], [], LOOK_S)[0]:
            if self._is_over() or time.monotonic() > deadline_s:
                raise TimeoutError(errno.ETIMEDOUT, "the fork server does not answer")

    def _close(self) -> None:
        if self._channel is not None:
            self._channel.close()
        self._channel, self._is_ready = None, False


def adopt_orphans() -> None:
    """Become the parent of what the children of this process leave behind.

    Raises:
        OSError: The kernel refuses.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "PR_SET_CHILD_SUBREAPER")


def bury(known: set[int]) -> None:
    """Reap the ended children that nobody else asks for.

    Args:
        known: Process ids of those that are asked for.
    """
    with contextlib.suppress(ChildProcessError):
        for _ in range(MOST_BURIED_COUNT):
            found = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
            if found is None or found.si_pid in known:
                return  # whoever asks for it reaps it, and the others come after
            os.waitpid(found.si_pid, 0)


def main(argv: Sequence[str]) -> None:
    """Import all, then fork for every wish; what is forked returns from here at its end.

    Args:
        argv: Handle of the supervisor's socket, names of the modules, and room for titles.
    """
    signal(SIGINT, SIG_IGN)
    channel = socket.socket(fileno=int(argv[0]))
    for name in argv[1:-1]:
        import_module(name)
    setproctitle(f"{sys.executable} -m workers.base.fork_server")
    gc.collect()
    gc.freeze()
    channel.sendall(_GO)
    while True:
        raw, handles, _, _ = socket.recv_fds(channel, MAX_WISH_BYTES, 2)
        if not raw:
            return
        if _fork_twice():
            channel.close()
            _become(msgspec.json.decode(raw, type=ForkRequest), *handles)
            return
        for handle in handles:
            os.close(handle)


def _fork_twice() -> bool:
    """Say whether this is the new process, whose parent is gone or about to be.

    Where the system gives no more processes, the handles of the wish are closed, and who has
    asked is told by that.
    """
    try:
        between = os.fork()
    except OSError:
        return False
    if between:
        os.waitpid(between, 0)
        return False
    try:
        is_between = bool(os.fork())
    except OSError:
        is_between = True
    if is_between:
        os._exit(0)
    return True


def _become(wish: ForkRequest, link: int, output: int | None = None) -> None:
    signal(SIGINT, default_int_handler)
    argv = [os.fsdecode(word) for word in wish.argv]
    with socket.socket(fileno=link) as told:
        while os.getppid() != wish.parent:
            _wait_for_parent(told)
        die_with_parent(wish.parent, wish.orphan_signal)
        setproctitle(" ".join([sys.executable, "-m", f"workers.{wish.kind}", *argv]))
        told.sendall(_PID.pack(os.getpid()))
        if told.recv(1) != _GO:
            raise SystemExit(EXIT_ORPHAN)
    if output is not None:
        os.dup2(output, _STDOUT)
        os.close(output)
    sys.argv = [f"workers.{wish.kind}", *argv]
    import_module(f"workers.{wish.kind}").main(argv)


def _wait_for_parent(told: socket.socket) -> None:
    """Wait a moment for the process between to end; leave with the supervisor."""
    if select.select([told], [], [], 0.0005)[0]:
        raise SystemExit(EXIT_ORPHAN)
