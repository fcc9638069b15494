"""Real ROS 2 beside the tests: one node, in an environment of its own."""

from __future__ import annotations

import json
import os
import secrets
import select
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from drivers.transports.ros2.bus import Bus
from drivers.transports.ros2.interfaces_table import INTERFACES
from drivers.transports.ros2.link import LinkSettings
from drivers.transports.ros2.message_definitions import Definitions
from drivers.transports.ros2.types import Types
from tests.fixtures.running import ROOT
from tests.workers.conftest import store, valkey_socket

__all__ = ["store", "valkey_socket"]

ROS = ROOT / ".cache/ros2"
SHARE = ROS / "share"
START_S = 120.0
PEER_TYPES = ("test_msgs/srv/BasicTypes", "test_msgs/action/Fibonacci")


class Peer:
    """A real node that does what it is told."""

    def __init__(self, python: Path, domain: int) -> None:
        kept = {name: os.environ[name] for name in ("PATH", "HOME", "LANG") if name in os.environ}
        environment = kept | {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        self._popen = subprocess.Popen(
            [str(python), str(Path(__file__).with_name("peer.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            bufsize=0,  # what is read ahead, `select` does not see
        )
        self._number = 0
        assert self._answer(START_S) == {"ready": True}

    def ask(self, what: str, timeout_s: float = 55.0, **rest: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
        """Let it do one thing, and return what came of it."""
        self.begin(what, **rest)
        return self._answer(timeout_s)

    def begin(self, what: str, **rest: Any) -> None:  # noqa: ANN401 - JSON
        """Let it begin; `end` waits for what comes of it."""
        assert self._popen.stdin is not None
        self._number += 1
        asked = json.dumps({"do": what, "number": self._number, **rest})
        self._popen.stdin.write(f"{asked}\n".encode())

    def end(self, timeout_s: float = 55.0) -> dict[str, Any]:
        """Return what came of what was begun."""
        return self._answer(timeout_s)

    def _answer(self, timeout_s: float) -> dict[str, Any]:
        """Return what came of the last request; of one that a test gave up it comes later."""
        assert self._popen.stdout is not None
        deadline_s = time.monotonic() + timeout_s
        while (left_s := deadline_s - time.monotonic()) > 0:
            ready, _, _ = select.select([self._popen.stdout], [], [], left_s)
            line = self._popen.stdout.readline() if ready else b""
            if line.startswith(b"{"):
                found: dict[str, Any] = json.loads(line)
                if found.pop("number", 0) == self._number:
                    return found
                continue
            assert not ready or line, f"the peer ended with {self._popen.wait(5)}"
        raise AssertionError(f"the peer said nothing within {timeout_s:g} s")

    def close(self) -> None:
        """End it."""
        self._popen.kill()
        self._popen.communicate()


@pytest.fixture(scope="session")
def ros_python() -> Path:
    """Find the interpreter that has rclpy; make its environment where it is not there."""
    problem, found = "", ""
    try:
        done = subprocess.run(
            ["bash", str(ROOT / "deploy/setup/ros2")],
            capture_output=True,
            text=True,
            timeout=900,
            check=False,
        )
        problem, found = done.stderr[-2000:] * bool(done.returncode), done.stdout.strip()
    except subprocess.TimeoutExpired as error:
        problem = str(error)
    if problem and os.environ.get("CI", "").lower() == "true":
        pytest.fail(f"rclpy cannot be installed: {problem}")
    if problem:
        pytest.skip(f"rclpy cannot be installed: {problem}")
    return Path(found)


@pytest.fixture(scope="session")
def domain() -> int:
    """Choose a domain that no other tests of this machine are likely to be in."""
    return 10 + secrets.randbelow(60)  # 77 to 79 have their own tests in this process


@pytest.fixture(scope="session")
def peer(ros_python: Path, domain: int) -> Iterator[Peer]:
    """Start the real node."""
    found = Peer(ros_python, domain)
    yield found
    found.close()


@pytest.fixture(scope="session")
def types(ros_python: Path) -> Types:
    """Know our interfaces, and those of the peer from the files that ROS has installed."""
    theirs = {name: SHARE.joinpath(f"{name}.{name.split('/')[1]}") for name in PEER_TYPES}
    return Types(Definitions(INTERFACES, {name: path.read_text() for name, path in theirs.items()}))


@pytest.fixture(scope="session")
def bus(types: Types, domain: int) -> Iterator[Bus]:
    """Take part beside the real node."""
    found = Bus(LinkSettings(domain=domain), types)
    yield found
    found.close()
