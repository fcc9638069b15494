"""The record of a run: who supervises, who was started, under which mark."""

from __future__ import annotations

import json
import secrets
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from signal import Signals
from typing import Any

from deploy.embedded import procfs
from deploy.embedded.layout import Layout, read_json, write_private

MARK = "LABWEB_RUN"
"""Environment variable that every process of a run carries, with the run's token."""


@dataclass(slots=True)
class ProcessEntry:
    """One started process."""

    process: procfs.Identity
    orphan_signal: Signals


@dataclass(slots=True)
class Record:
    """What is written to ``run/pids.json`` at every start and end of a process."""

    supervisor: procfs.Identity
    """The process to signal: a lab's guard, or whoever uses the servers alone."""

    token: str = field(default_factory=lambda: secrets.token_hex(16))
    url: str = ""
    lab: str = ""
    speed: float = 1.0
    processes: dict[str, ProcessEntry] = field(default_factory=dict)

    def save(self, layout: Layout) -> None:
        """Write it down in one step.

        Raises:
            OSError: The disk refuses; what was written before stands. The mark of its processes
                is in it, by which the next start finds them all the same.
        """
        write_private(_path(layout), json.dumps(self._to_json(), indent=1) + "\n")

    def is_running(self) -> bool:
        """Tell whether the supervisor that wrote this is alive."""
        return procfs.is_alive(self.supervisor)

    def _to_json(self) -> dict[str, Any]:
        return {
            "boot": procfs.boot_id(),
            "token": self.token,
            "url": self.url,
            "lab": self.lab,
            "speed": self.speed,
            "supervisor": [self.supervisor.pid, self.supervisor.started_ticks],
            "processes": {
                name: [entry.process.pid, entry.process.started_ticks, int(entry.orphan_signal)]
                for name, entry in self.processes.items()
            },
        }


def begin(pid: int) -> Record:
    """Open the record of a run that ends with this process."""
    supervisor = procfs.identify(pid)
    if supervisor is None:
        raise OSError(f"/proc does not show process {pid}")
    return Record(supervisor)


def load(layout: Layout) -> Record | None:
    """Read the last run's record; None when there is none, or it is of an earlier boot."""
    content = read_json(_path(layout))
    if not isinstance(content, dict):
        return None
    try:
        if content["boot"] != procfs.boot_id():
            return None
        record = Record(procfs.Identity(*content["supervisor"]), content["token"])
        record.url, record.lab = content["url"], content["lab"]
        record.speed = content["speed"]
        for name, (pid, started_ticks, number) in content["processes"].items():
            entry = ProcessEntry(procfs.Identity(pid, started_ticks), Signals(number))
            record.processes[name] = entry
    except (KeyError, TypeError, ValueError):
        return None
    return record


def forget(layout: Layout) -> None:
    """Remove the record after a clean stop; one that stays names processes that are gone."""
    with suppress(OSError):
        _path(layout).unlink(missing_ok=True)


def _path(layout: Layout) -> Path:
    return layout.run / "pids.json"
