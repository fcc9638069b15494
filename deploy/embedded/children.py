"""One child process: how it is started, where its output goes, how it is told to stop."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from signal import Signals
from typing import IO

from deploy.embedded import procfs

LAUNCHER = Path(__file__).with_name("launch.py")
LONGEST_LOG_BYTES = 10_000_000
_TAIL_BYTES = 4096


class StopOrder(IntEnum):
    """Who stops before whom."""

    EDGE_HOST = 0
    """First: it brings its devices to rest while all it needs still runs."""

    OTHERS = 1
    """Everything that talks to the broker or the database."""

    BROKER = 2
    """Valkey."""

    DATABASE = 3
    """PostgreSQL, last."""


@dataclass(frozen=True, slots=True)
class Process:
    """A program that runs as long as the lab does."""

    name: str
    """Unique in the lab; also the name of its log."""

    argv: tuple[str, ...]
    """The program by its whole path, then its arguments."""

    stop_order: StopOrder = StopOrder.OTHERS

    after_web: bool = False
    """Start once web answers, so that the first page does not wait for it."""

    stop_signal: Signals = Signals.SIGTERM
    """What asks it to end in good order."""

    orphan_signal: Signals = Signals.SIGTERM
    """What the kernel sends it when the supervisor dies."""

    identity: str = "same"
    """Who it runs as: ``same``, ``userns`` or ``user:NAME`` (see `launch`)."""


def command_of(process: Process) -> list[str]:
    """Wrap a program so that it ends when this process does."""
    signal_number = int(process.orphan_signal)
    wrapper = [sys.executable, "-I", "-S", str(LAUNCHER), str(os.getpid()), str(signal_number)]
    return [*wrapper, process.identity, *process.argv]


def spawn(
    process: Process, *, environment: Mapping[str, str], log: Path, folder: Path
) -> subprocess.Popen[bytes]:
    """Start a process in a session of its own, with its output in its log.

    Call it from the main thread: the kernel takes the end of the calling thread for the
    end of the parent.

    Raises:
        OSError: Its log cannot be opened, or the system gives no process or no file.
    """
    rotate(log)
    with open_log(log) as stream:
        return subprocess.Popen(
            command_of(process),
            cwd=folder,
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )


def run_once(
    argv: Sequence[str],
    *,
    identity: str = "same",
    environment: Mapping[str, str],
    log: Path,
    text: str = "",
) -> int:
    """Run a short program to its end and return its exit code."""
    process = Process(Path(argv[0]).name, tuple(argv), identity=identity)
    with open_log(log) as stream:
        done = subprocess.run(
            command_of(process),
            env=dict(environment),
            cwd="/",
            input=text.encode(),
            stdout=stream,
            stderr=subprocess.STDOUT,
            check=False,
        )
    return done.returncode


def open_log(log: Path) -> IO[bytes]:
    """Open a log to append to; it is readable by its owner alone."""
    descriptor = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o600)
    return os.fdopen(descriptor, "ab")


def rotate(log: Path) -> None:
    """Keep one older part of a log that has grown past its bound.

    The file is copied and emptied and not renamed, because a running process goes on
    writing to the file that it has open; it appends, so it goes on at the new end. A disk
    without room for the copy leaves the log as it is.
    """
    if not log.exists() or log.stat().st_size <= LONGEST_LOG_BYTES:
        return
    older = log.with_name(f"{log.name}.1")
    try:
        shutil.copyfile(log, older)
        os.truncate(log, 0)
    except OSError:
        with suppress(OSError):
            older.unlink(missing_ok=True)


def last_lines(log: Path, count: int = 1) -> list[str]:
    """Read the last written lines of a log."""
    try:
        with log.open("rb") as stream:
            size = stream.seek(0, os.SEEK_END)
            stream.seek(max(0, size - _TAIL_BYTES))
            text = stream.read().decode("utf-8", "replace")
    except OSError:
        return []
    return [line for line in text.splitlines() if line.strip()][-count:]


def describe_exit(code: int) -> str:
    """Say how a process ended, from its return code."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {Signals(-code).name}"
    except ValueError:
        return f"signal {-code}"


def identity_of(popen: subprocess.Popen[bytes]) -> procfs.Identity | None:
    """Name a child for good, or None when it has already ended."""
    return procfs.identify(popen.pid)
