"""Child processes of the host: started, watched, started again, ended."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from signal import SIGKILL, SIGTERM, SIGUSR2, Signals
from typing import Protocol
from uuid import UUID

from labweb.domain.messages.devices_and_drivers import DeviceConfig

log = logging.getLogger(__name__)

FIRST_PAUSE_S = 0.2
LONGEST_PAUSE_S = 8.0
STEADY_S = 10.0
"""A process that ran this long had a good start: the next pause is short again."""


class StartedProcess(Protocol):
    """What was started, as far as anybody here asks."""

    @property
    def pid(self) -> int:
        """Its process id."""

    @property
    def returncode(self) -> int | None:
        """Its exit code; None: it ran when it was last asked for."""

    def poll(self) -> int | None:
        """Return its exit code, and reap it; None: it runs."""

    def send_signal(self, sig: Signals, /) -> None:
        """Send it a signal, if it runs."""


@dataclass
class ChildProcess:
    """One process that shall run as long as the host does."""

    name: str
    start: Callable[[], StartedProcess | None]
    """Starts it; None: it cannot be started yet. An OSError says that it failed."""

    fingerprint: str = ""
    """Changes when the process has to be replaced."""

    digests: Mapping[UUID, str] = field(default_factory=dict)
    """Version of the driver by device, as the process was started with."""

    is_leaving: bool = False
    """It was told to let another process take over."""

    process: StartedProcess | None = None
    _started_s: float = 0.0
    _next_start_s: float = 0.0
    _pause_s: float = field(default=FIRST_PAUSE_S)

    @property
    def is_running(self) -> bool:
        """Say whether it runs, and reap it if not."""
        return self.process is not None and self.process.poll() is None

    def keep(self) -> None:
        """Start it unless it runs; after a quick end, wait longer each time."""
        now_s = time.monotonic()
        if self.is_running:
            return
        if self.process is not None:
            self._note_end(self.process, now_s)
        if now_s < self._next_start_s:
            return
        try:
            started = self.start()
        except OSError as error:
            log.error("%s cannot be started: %s", self.name, error)
            self._put_off(now_s)
            return
        if started is not None:
            self.process, self._started_s = started, now_s
            log.info("%s runs as process %d", self.name, started.pid)

    def _note_end(self, process: StartedProcess, now_s: float) -> None:
        if self.is_leaving:
            self.is_leaving, self.process, self._next_start_s = False, None, now_s
            log.info("%s has left", self.name)
            return
        log.warning("%s ended with code %s", self.name, process.returncode)
        if now_s - self._started_s > STEADY_S:
            self._pause_s = FIRST_PAUSE_S
        self._put_off(now_s)
        self.process = None

    def _put_off(self, now_s: float) -> None:
        self._next_start_s = now_s + self._pause_s
        self._pause_s = min(self._pause_s * 2, LONGEST_PAUSE_S)

    def mark(self, fingerprint: str, devices: Iterable[DeviceConfig]) -> None:
        """Note which devices it serves, with which versions."""
        self.fingerprint = fingerprint
        self.digests = {device.id: device.digest for device in devices}

    def leave(self) -> None:
        """Let it end after what it does now, for another to take over at once."""
        self.is_leaving = True
        self.tell(SIGUSR2)

    def tell(self, number: Signals = SIGTERM) -> None:
        """Send it a signal, if it runs."""
        if self.process is not None and self.is_running:
            self.process.send_signal(number)


def start_program(argv: Sequence[str], environment: Mapping[str, str]) -> StartedProcess:
    """Start another program, which ends at once when this process dies.

    Raises:
        OSError: It cannot be started.
    """
    tied = [
        sys.executable,
        "-m",
        "workers.base.parent_death_signal",
        str(os.getpid()),
        str(int(SIGKILL)),
        "exec",
    ]
    return subprocess.Popen([*tied, *argv], env=dict(environment), stdin=subprocess.DEVNULL)
