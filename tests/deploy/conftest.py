"""Start labs as a person does, and see to it that none outlives its test."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import TypeVar
from urllib.request import urlopen

import pytest

from deploy.embedded import external, leftovers, procfs, record
from deploy.embedded.layout import Layout, close_sockets

PLAIN_LAB = Path(__file__).with_name("plain_lab.py")
START_TIMEOUT_S = 30.0


@dataclass
class RunningLab:
    """One supervisor, what it says, and where it works."""

    data: Path
    port: int
    popen: subprocess.Popen[str]
    said: list[str] = field(default_factory=list)

    def get(self, path: str = "/") -> dict[str, object]:
        """Ask the lab's page."""
        with urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=5) as answer:
            content: dict[str, object] = json.load(answer)
        return content

    def wait_said(self, text: str, timeout_s: float = START_TIMEOUT_S) -> str:
        """Wait for a line that holds the text."""
        found = wait_until(lambda: [line for line in self.said if text in line], timeout_s)
        assert found, f"{text!r} was not said in: {''.join(self.said)}"
        return found[0]

    def pids(self) -> set[int]:
        """List every process of the lab, the supervisor and workers of workers included."""
        last = record.load(Layout(self.data))
        assert last is not None
        recorded = {entry.process.pid for entry in last.processes.values()}
        return recorded | {self.popen.pid, self.supervisor_pid()} | set(self.worker_pids()[-1:])

    def supervisor_pid(self) -> int:
        """Find the supervisor, the only child of the process that was started."""
        (pid,) = procfs.children_of(self.popen.pid)
        return pid

    def worker_pids(self) -> list[int]:
        """List the workers that edge hosts have started, oldest first."""
        path = self.data / "workers"
        lines = path.read_text(encoding="ascii").splitlines() if path.exists() else []
        return [int(line.split()[1]) for line in lines]

    def end(self, number: signal.Signals) -> float:
        """Signal the supervisor and return how long it took to leave."""
        began = monotonic()
        self.popen.send_signal(number)
        self.popen.wait(10)
        return monotonic() - began


def surroundings() -> dict[str, str]:
    """Give this process's environment without the addresses that its servers have."""
    without = {name: value for name, value in os.environ.items() if name not in external.NAMES}
    return without | {"PYTHONDONTWRITEBYTECODE": "1", "LABWEB_BROKER_URL": "amqp://elsewhere"}


T = TypeVar("T")


def wait_until(found: Callable[[], T], timeout_s: float) -> T:
    """Ask again and again until the answer is true, and return the last one."""
    deadline = monotonic() + timeout_s
    pause = threading.Event()
    while not (answer := found()) and monotonic() < deadline:
        pause.wait(0.05)
    return answer


def is_alive(pid: int) -> bool:
    """Tell whether a process runs; a zombie does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state not in "ZX"


@pytest.fixture
def free_port() -> int:
    """Give a port that nothing listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


@pytest.fixture
def lab_file(tmp_path: Path) -> Path:
    """Give a lab file with a lab's name in its path."""
    path = tmp_path / "bench" / "lab.json"
    path.parent.mkdir()
    path.write_text("{}", encoding="utf-8")
    return path


StartLab = Callable[..., RunningLab]


@pytest.fixture
def start_lab(lab_file: Path, tmp_path: Path, free_port: int) -> Iterator[StartLab]:
    """Start the plain lab; whatever runs at the end of the test is ended."""
    labs: list[RunningLab] = []

    def start(
        data: Path = tmp_path / "data",
        port: int = free_port,
        given: Mapping[str, str] | None = None,
    ) -> RunningLab:
        command = [sys.executable, str(PLAIN_LAB), "run", "--lab", str(lab_file)]
        popen = subprocess.Popen(
            [*command, "--data", str(data), "--port", str(port)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
            env=surroundings() | dict(given or {}),
        )
        lab = RunningLab(data, port, popen)
        threading.Thread(target=_listen, args=(lab,), daemon=True).start()
        labs.append(lab)
        return lab

    yield start
    for lab in labs:
        if lab.popen.poll() is None:
            lab.popen.kill()
        lab.popen.wait()
        last = record.load(Layout(lab.data))
        if last is not None:
            leftovers.end(last, grace_s=0.5)
        close_sockets(Layout(lab.data))


def _listen(lab: RunningLab) -> None:
    assert lab.popen.stdout is not None
    with lab.popen.stdout as stream:
        for line in stream:
            lab.said.append(line)
