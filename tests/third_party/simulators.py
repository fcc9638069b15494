"""Simulators that others wrote, started as programs of the environment `third-party`."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

START_S = 30.0


def free_port() -> int:
    """Return a port that nobody listens at, for programs that cannot choose one themselves."""
    with socket.create_server(("127.0.0.1", 0)) as found:
        port: int = found.getsockname()[1]
        return port


@contextmanager
def program(
    python: Path, folder: Path, *words: str, opens: int | Path, **variables: str
) -> Iterator[None]:
    """Run a module of others until the block ends.

    Args:
        python: The interpreter that has it.
        folder: Where it runs, and writes its log.
        words: What follows `python -m`.
        opens: The TCP port or the serial port by which it is known to be ready.
        variables: Of its environment, beside those of this process.
    """
    log = folder / "log"
    with log.open("w") as stream:
        running = subprocess.Popen(
            [str(python), "-m", *words],
            cwd=folder,
            env={**os.environ, **variables, "PYTHONPATH": str(folder)},
            stdout=stream,
            stderr=subprocess.STDOUT,
        )
    try:
        _await(running, log, opens)
        yield
    finally:
        running.terminate()
        try:
            running.wait(10)
        except subprocess.TimeoutExpired:
            running.kill()
            running.wait()


def _await(running: subprocess.Popen[bytes], log: Path, opens: int | Path) -> None:
    deadline = time.monotonic() + START_S
    while not _is_open(opens):
        assert running.poll() is None, log.read_text()
        assert time.monotonic() < deadline, log.read_text()
        time.sleep(0.05)


def _is_open(place: int | Path) -> bool:
    if isinstance(place, Path):
        return place.exists()
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", place)) == 0
