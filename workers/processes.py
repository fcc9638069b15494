"""Child processes of the host: started, watched, started again, ended."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from signal import SIGKILL, SIGTERM, SIGUSR2, Signals
from uuid import UUID

from labweb.domain.messages import DeviceConfig

log = logging.getLogger(__name__)

FIRST_PAUSE_S = 0.2
LONGEST_PAUSE_S = 8.0
STEADY_S = 10.0
"""A process that ran this long had a good start: the next pause is short again."""


@dataclass
class Child:
    """One process that shall run as long as the host does."""

    name: str
    arguments: Sequence[str]
    """What `workers.child` is called with, after parent and signal."""

    orphan_signal: Signals = SIGKILL
    """What the kernel sends it when the supervisor dies."""

    fingerprint: str = ""
    """Changes when the process has to be replaced."""

    digests: Mapping[UUID, str] = field(default_factory=dict)
    """Version of the driver by device, as the process was started with."""

    is_leaving: bool = False
    """It was told to let another process take over."""

    popen: subprocess.Popen[bytes] | None = None
    _started_s: float = 0.0
    _next_start_s: float = 0.0
    _pause_s: float = field(default=FIRST_PAUSE_S)

    @property
    def is_running(self) -> bool:
        """Say whether it runs, and reap it if not."""
        return self.popen is not None and self.popen.poll() is None

    def keep(self, environment: Mapping[str, str]) -> None:
        """Start it unless it runs; after a quick end, wait longer each time."""
        now_s = time.monotonic()
        if self.is_running:
            return
        if self.popen is not None:
            self._note_end(self.popen, now_s)
        if now_s < self._next_start_s:
            return
        argv = [sys.executable, "-m", "workers.child", str(os.getpid())]
        argv += [str(int(self.orphan_signal)), *self.arguments]
        self.popen = subprocess.Popen(argv, env=dict(environment), stdin=subprocess.DEVNULL)
        self._started_s = now_s
        log.info("%s runs as process %d", self.name, self.popen.pid)

    def _note_end(self, popen: subprocess.Popen[bytes], now_s: float) -> None:
        if self.is_leaving:
            self.is_leaving, self.popen, self._next_start_s = False, None, now_s
            log.info("%s has left", self.name)
            return
        log.warning("%s ended with code %s", self.name, popen.returncode)
        if now_s - self._started_s > STEADY_S:
            self._pause_s = FIRST_PAUSE_S
        self._next_start_s = now_s + self._pause_s
        self._pause_s = min(self._pause_s * 2, LONGEST_PAUSE_S)
        self.popen = None

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
        if self.popen is not None and self.is_running:
            self.popen.send_signal(number)
