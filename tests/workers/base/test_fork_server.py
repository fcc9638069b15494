"""The process that starts the host's others: whose children they are, what they hold, and ends."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from deploy.embedded.procfs import has_environment
from tests.workers.bench import ROOT, environment, until

SUPERVISOR = """
import json, os, sys, tempfile, threading
from signal import SIGKILL, SIGTERM
from workers.base import fork_server
from workers.base.fork_server import ForkServer, bury
from workers.host.preloaded_modules import IMPORTS

forks = ForkServer(os.environ, IMPORTS)
for text in sys.stdin:
    order = json.loads(text)
    found = {}
    if order["do"] == "fork":
        started, output = None, tempfile.TemporaryFile()
        while started is None:
            threading.Event().wait(0.02)
            try:
                started = forks.fork(SIGTERM, "forked_probe", order["argv"], output)
            except OSError as error:
                found["failed"] = str(error)
                if not order["is_patient"]:
                    break
        if started is not None:
            found["pid"] = started.pid
        if started is not None and order["waits"]:
            started.wait()
            found["code"] = started.returncode
            output.seek(0)
            found["said"] = output.read().decode()
    elif order["do"] == "keep":
        fork_server.READY_WITHIN_S = order["ready_s"]
        forks.keep()
    elif order["do"] == "bury":
        bury(set(order["known"]))
    found["server"] = sorted(forks.pids())
    print(json.dumps(found), flush=True)
"""


class Supervisor:
    """Forks in a process of its own, which a test may kill."""

    def __init__(self, folder: Path) -> None:
        # What is forked is a module of `workers`; this one is the test's.
        package = folder / "workers"
        package.mkdir()
        (package / "forked_probe.py").write_text(PROBE)
        start = f"import workers; workers.__path__.append({str(package)!r})\n"
        self.no_fork = folder / "no_fork"
        start += FAILING.format(path=str(self.no_fork))
        (folder / "sitecustomize.py").write_text(start)
        self._popen = subprocess.Popen(
            [sys.executable, "-c", SUPERVISOR],
            cwd=ROOT,
            env=environment(PYTHONPATH=f"{folder}:{ROOT}", OF_THE_HOST="yes"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.pid = self._popen.pid
        self.server = 0

    def ask(self, **order: Any) -> dict[str, Any]:  # noqa: ANN401 - any field
        assert self._popen.stdin is not None
        assert self._popen.stdout is not None
        self._popen.stdin.write(msgspec.json.encode(order).decode() + "\n")
        self._popen.stdin.flush()
        found: dict[str, Any] = msgspec.json.decode(self._popen.stdout.readline())
        (self.server,) = found["server"] or [0]
        return found

    def fork(self, *argv: str, waits: bool = True, is_patient: bool = True) -> dict[str, Any]:
        """Fork the probe; patient: again and again until it has come about."""
        return self.ask(do="fork", argv=list(argv), waits=waits, is_patient=is_patient)

    def kill(self) -> None:
        self._popen.kill()
        self._popen.communicate()


FAILING = """
import errno, os

_fork, _count = os.fork, 0

def fork():
    global _count
    try:
        with open({path!r}) as file:
            wanted = int(file.read())
    except OSError:
        return _fork()
    _count += 1
    if _count == wanted:
        _count = 0
        raise BlockingIOError(errno.EAGAIN, "no more processes")
    return _fork()

os.fork = fork
"""
"""The system gives no more processes, at the first fork or at the second, while a file says so."""

PROBE = """
import json, os, signal, sys, threading

def main(argv):
    if argv[0] == "look":
        handles = {}
        for name in os.listdir("/proc/self/fd"):
            try:
                handles[name] = os.readlink(f"/proc/self/fd/{name}")
            except OSError:
                pass
        parent = os.getppid()
        print(json.dumps({
            "parent": parent,
            "handles": handles,
            "threads": len(os.listdir("/proc/self/task")),
            "is_imported": "celery.worker.strategy" in sys.modules,
            "host": os.environ.get("OF_THE_HOST"),
            "title": sys.argv,
            "interrupt": signal.getsignal(signal.SIGINT) is signal.default_int_handler,
        }))
    elif argv[0] == "exit":
        sys.exit(int(argv[1]))
    elif argv[0] == "leave":
        left = os.fork()
        if left:
            print(left, flush=True)
        os._exit(0)
    else:
        threading.Event().wait(60)
"""


@pytest.fixture
def supervisor() -> Iterator[Supervisor]:
    with tempfile.TemporaryDirectory(prefix="fs") as name:
        made = Supervisor(Path(name))
        try:
            yield made
        finally:
            made.kill()


def test_what_is_forked_is_the_supervisors_child_and_holds_nothing_of_the_fork_server(
    supervisor: Supervisor,
) -> None:
    found = msgspec.json.decode(supervisor.fork("look")["said"])
    assert found["parent"] == supervisor.pid
    assert (found["threads"], found["is_imported"], found["host"]) == (1, True, "yes")
    assert found["interrupt"]
    assert found["title"] == ["workers.forked_probe", "look"]
    inherited = _handles(supervisor.server)
    sockets = {at for at in found["handles"].values() if at.startswith("socket:")}
    assert any(at.startswith("socket:") for at in inherited)
    assert not sockets


def test_its_exit_code_is_the_supervisors_to_read(supervisor: Supervisor) -> None:
    assert supervisor.fork("exit", "7")["code"] == 7
    assert supervisor.fork("exit", "0")["code"] == 0


def test_it_says_in_the_list_of_processes_what_it_is(supervisor: Supervisor) -> None:
    pid = supervisor.fork("sit", "a line", waits=False)["pid"]
    title = Path(f"/proc/{pid}/cmdline").read_bytes().rstrip(b"\0").decode()
    assert title == f"{sys.executable} -m workers.forked_probe sit a line"
    assert has_environment(pid, "OF_THE_HOST", "yes"), "the title is written over it"


def test_it_dies_with_the_supervisor_and_not_with_the_fork_server(supervisor: Supervisor) -> None:
    first = supervisor.fork("sit", waits=False)["pid"]
    server = supervisor.server
    os.kill(server, signal.SIGKILL)
    second = supervisor.fork("sit", waits=False)["pid"]
    assert supervisor.server != server
    assert _runs(first)
    assert _runs(second)
    supervisor.kill()
    until(lambda: not any(map(_runs, (first, second, supervisor.server))))


@pytest.mark.parametrize("which", ["1", "2"])
def test_where_the_system_gives_no_more_processes_the_fork_server_stays(
    supervisor: Supervisor, which: str
) -> None:
    supervisor.fork("exit", "0")
    server = supervisor.server
    supervisor.no_fork.write_text(which)
    found = supervisor.fork("exit", "4", is_patient=False)
    assert "could not fork" in found["failed"]
    assert "code" not in found
    supervisor.no_fork.unlink()
    assert supervisor.fork("exit", "4", is_patient=False)["code"] == 4
    assert supervisor.server == server


def test_a_fork_server_that_is_never_ready_is_replaced(
    supervisor: Supervisor,
) -> None:
    supervisor.ask(do="keep", ready_s=0.5)
    stuck = supervisor.server
    os.kill(stuck, signal.SIGSTOP)
    until(lambda: supervisor.ask(do="keep", ready_s=0.5) and not _runs(stuck))
    until(lambda: supervisor.ask(do="keep", ready_s=120.0) and supervisor.server not in {0, stuck})
    assert supervisor.fork("exit", "6")["code"] == 6


def test_a_fork_server_that_hangs_is_replaced(supervisor: Supervisor) -> None:
    supervisor.fork("exit", "0")
    stuck = supervisor.server
    os.kill(stuck, signal.SIGSTOP)
    began_s = time.monotonic()
    found = supervisor.fork("exit", "3")
    assert time.monotonic() - began_s > 5
    assert (found["code"], supervisor.server == stuck) == (3, False)
    assert not _runs(stuck)


def test_what_its_processes_leave_behind_is_reaped_and_nothing_that_is_asked_for(
    supervisor: Supervisor,
) -> None:
    left = int(supervisor.fork("leave")["said"])
    until(lambda: _state(left) in {"Z", ""})
    kept = supervisor.fork("exit", "5", waits=False)["pid"]
    until(lambda: _state(kept) == "Z")
    until(lambda: supervisor.ask(do="bury", known=[kept, supervisor.server]) and not _state(left))
    assert _state(kept) == "Z"
    supervisor.ask(do="bury", known=[supervisor.server])
    assert _state(kept) == ""


def _handles(pid: int) -> list[str]:
    found = []
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            found.append(str(entry.readlink()))
    return found


def _runs(pid: int) -> bool:
    return _state(pid) not in {"", "Z", "X"}


def _state(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()[0]
    except OSError:
        return ""
