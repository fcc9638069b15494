"""Try a staged version of a driver in a process of its own, and tell the server how it went."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from signal import SIGKILL
from typing import IO
from uuid import UUID

import msgspec

from drivers.transports.urls import line_key, make_transport
from labweb.domain.errors import LabError
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from workers.base.config import HostConfig, load_config
from workers.base.device_lines import fingerprint
from workers.base.fork_server import Forked, ForkServer
from workers.journal.journal import Journal
from workers.line.driver_reports import tell_refused
from workers.line.driver_store import DriverLoader, DriverStore, is_installed
from workers.line.line_confinement import confine_line

log = logging.getLogger(__name__)

WITHIN_S = 60.0
"""Longest time that a version may take to be imported and built, on a busy machine."""

MAX_ANSWER_BYTES = 256 * 1024


class TrialAnswer(msgspec.Struct, frozen=True):
    """What a trial says of one device, as a line of its output."""

    device_id: UUID
    code: str = ""
    """Empty: the driver was built."""

    message: str = ""


@dataclass
class _Trial:
    devices: list[DeviceConfig]
    process: Forked
    output: IO[bytes]
    began_s: float = field(default_factory=time.monotonic)


class DriverTrials:
    """Starts and watches the trials of a host, one process for each version.

    A version is tried once for each device, as long as it is staged there.
    """

    def __init__(self, config: HostConfig, path: Path, forks: ForkServer) -> None:
        self._store = DriverStore(config.drivers_folder)
        self._path = path
        self._forks = forks
        self._running: dict[str, _Trial] = {}
        self._done: set[str] = set()

    def keep(self, journal: Journal) -> None:
        """Begin what is due, and tell of what has ended."""
        staged = {fingerprint([device]): device for device in journal.staged()}
        self._done &= staged.keys()
        due: dict[str, list[DeviceConfig]] = {}
        for mark, device in staged.items():
            if mark not in self._done and self._is_here(device):
                due.setdefault(device.digest, []).append(device)
        for digest, devices in due.items():
            if digest not in self._running and (begun := self._begin(devices)) is not None:
                self._running[digest] = begun
        for digest, trial in list(self._running.items()):
            if self._has_ended(trial):
                del self._running[digest]
                tried = [one for one in trial.devices if fingerprint([one]) in staged]
                self._done |= {fingerprint([one]) for one in tried}
                _tell(journal, trial, tried)

    def pids(self) -> set[int]:
        """Return the process ids of what runs."""
        return {trial.process.pid for trial in self._running.values()}

    def end(self) -> None:
        """End what runs."""
        for trial in self._running.values():
            trial.process.kill()
            trial.process.wait()
            trial.output.close()

    def _is_here(self, device: DeviceConfig) -> bool:
        return is_installed(device.module, device.digest) or self._store.has(device.digest)

    def _begin(self, devices: list[DeviceConfig]) -> _Trial | None:
        argv = [str(self._path), *(str(device.id) for device in devices)]
        with ExitStack() as undo:
            try:
                output = undo.enter_context(tempfile.TemporaryFile())
                process = self._forks.fork(SIGKILL, "tryouts.driver_trial", argv, output)
            except OSError as error:
                log.error("no driver can be tried: %s", error)
                return None
            if process is None:
                return None
            undo.pop_all()
            return _Trial(devices, process, output)

    def _has_ended(self, trial: _Trial) -> bool:
        if trial.process.poll() is None and time.monotonic() - trial.began_s > WITHIN_S:
            trial.process.kill()
            trial.process.wait()
        return trial.process.poll() is not None


def _tell(journal: Journal, trial: _Trial, devices: list[DeviceConfig]) -> None:
    answers = _answers(trial)
    took_s = time.monotonic() - trial.began_s
    late = f", it may take {WITHIN_S:.0f} s" if trial.process.returncode == -SIGKILL else ""
    text = f"the driver ended its process with code {trial.process.returncode}{late}"
    for device in devices:
        answer = answers.get(device.id) or TrialAnswer(device.id, code="driver.trial", message=text)
        if answer.code:
            log.error("device %s keeps its driver: %s", device.key, answer.message)
            tell_refused(journal, [device], answer.code, answer.message)
            continue
        log.info("device %s: driver %s is ready, %.2f s", device.key, device.digest[:12], took_s)
        with journal.write() as tx:
            body = {"device_id": str(device.id), "digest": device.digest}
            tx.append("driver_ready", None, body)


def _answers(trial: _Trial) -> dict[UUID, TrialAnswer]:
    """Read what a trial has said; a driver may have printed anything in between."""
    trial.output.seek(0, os.SEEK_END)
    trial.output.seek(max(0, trial.output.tell() - MAX_ANSWER_BYTES))
    found = {}
    for line in trial.output.read().splitlines():
        with contextlib.suppress(msgspec.MsgspecError):
            answer = msgspec.json.decode(line, type=TrialAnswer)
            found[answer.device_id] = answer
    trial.output.close()
    return found


def run_trial(config: HostConfig, device_ids: Sequence[UUID]) -> None:
    """Build the staged drivers of some devices once, as their line would; nothing is opened."""
    journal = Journal(config.journal_path)
    staged = [device for device in journal.staged() if device.id in device_ids]
    keys = journal.command_keys()
    journal.close()
    is_confined = False
    for device in staged:
        try:
            if not is_confined:
                confine_line(config, line_key(device.transport), staged)
                is_confined = True
            drivers = DriverLoader(DriverStore(config.drivers_folder), keys)
            drivers.load(device, make_transport(device.transport))
            answer = TrialAnswer(device.id)
        except LabError as error:
            answer = TrialAnswer(device.id, error.code, error.message[:2000])
        sys.stdout.buffer.write(b"\n" + msgspec.json.encode(answer) + b"\n")
        sys.stdout.buffer.flush()


def main(argv: Sequence[str]) -> None:
    """Run a trial: the file of the host's configuration, and the devices."""
    run_trial(load_config(Path(argv[0])), [UUID(text) for text in argv[1:]])
