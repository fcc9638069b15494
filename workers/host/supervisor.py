"""The supervisor of one edge host: starts its processes, watches them, and ends them in order."""

from __future__ import annotations

import logging
import os
import threading
import time
from pathlib import Path
from signal import SIGCHLD, SIGINT, SIGKILL, SIGTERM, signal

from redis.exceptions import RedisError

from labweb.domain.errors import LabError, StateError
from labweb.domain.runs.host_journal.action_states import ActionState
from workers.base.celery_apps import make_host_app, wake
from workers.base.config import HostConfig, line_queue
from workers.base.device_lines import fingerprint, lines_of
from workers.base.fork_server import ForkServer, bury
from workers.base.host_lock import lock_host
from workers.base.valkey_store import ValkeyStore
from workers.base.wake_pipe import WakePipe, ring
from workers.enrollment.host_identity import load_identity
from workers.host.child_processes import ChildProcess
from workers.host.preloaded_modules import IMPORTS
from workers.host.valkey_process import valkey_child
from workers.journal.journal import Journal, check_journal, create_journal
from workers.sandbox.address_bounds import marks_of
from workers.sandbox.confinement import describe, is_possible
from workers.tryouts.driver_trial import DriverTrials
from workers.uplink.session import disarm_if_regressed, record_boot

log = logging.getLogger(__name__)

TICK_S = 0.1
"""How long what the bell would have told may wait, should it be lost."""

LINES_EVERY_S = 0.2
RING_EVERY_S = 1.0
PRUNE_EVERY_S = 3600.0
VALKEY_START_S = 10.0
HALT_S = 5.0
"""How long after the grace a line may take to bring its devices to rest."""


class HostSupervisor:
    """Starts and watches the host's processes."""

    def __init__(self, config: HostConfig, path: Path) -> None:
        """Take the host's lock, and check journal and key.

        Raises:
            LabError: The host runs already, or its journal or key cannot be used.
        """
        self._config = config
        self._path = path
        config.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._lock = lock_host(config)
        load_identity(Path(config.key_file), config.ca_path)
        create_journal(config.journal_path, config.host_id)
        check_journal(config.journal_path)
        self._journal = Journal(config.journal_path)
        self._do(self._journal.lengthen_log)
        record_boot(self._journal)
        if not is_possible() and not config.accepts_unconfined:
            text = f"{describe()}; to run drivers all the same, set unconfined to accept"
            raise StateError(text, code="host.unconfined")
        log.info("lines: %s", describe())
        reason = disarm_if_regressed(self._journal)
        if reason is not None:
            log.error("the journal is not the newest one (%s): nothing starts here", reason)
        self._store = ValkeyStore(config.valkey_url)
        self._host_app = make_host_app(config)
        self._services = self._make_services()
        self._lines: dict[str, ChildProcess] = {}
        self._stopping = threading.Event()
        environment = _environment(config)
        self._forks = ForkServer(environment, IMPORTS, self._stopping.is_set)
        self._trials = DriverTrials(config, path, self._forks)
        self._valkey = valkey_child(config, environment)
        self._bell = WakePipe(config.supervisor_bell)
        self._signals_count = 0

    def run(self) -> None:
        """Run until told to end, then end everything in good order."""
        for number in (SIGTERM, SIGINT):
            signal(number, self._on_signal)
        signal(SIGCHLD, self._on_child)
        try:
            self._forks.keep()
            self._start_valkey()
            self._watch()
        finally:
            self._end()

    # --- while it runs ---

    def _watch(self) -> None:
        due = {self._try: 0.0, self._keep_lines: 0.0, self._ring: 0.0, self._prune: 0.0}
        every_s = {
            self._try: TICK_S,
            self._keep_lines: LINES_EVERY_S,
            self._ring: RING_EVERY_S,
            self._prune: PRUNE_EVERY_S,
        }
        while not self._stopping.is_set():
            self._keep(*self._services, *self._lines.values())
            for task, due_s in due.items():
                if time.monotonic() >= due_s:
                    due[task] = time.monotonic() + every_s[task]
                    self._do(task)
            if self._bell.wait(TICK_S):
                due |= {self._try: 0.0, self._keep_lines: 0.0}

    def _try(self) -> None:
        """Build staged versions of drivers once, and tell how it went."""
        self._trials.keep(self._journal)

    def _do(self, task: object) -> None:
        try:
            task()  # type: ignore[operator]
        except (LabError, RedisError, OSError) as error:
            log.error("%s", error)

    def _keep(self, *children: ChildProcess) -> None:
        self._forks.keep()
        known = [child for child in (self._valkey, *children) if child is not None]
        for child in known:
            child.keep()
        running = [child.process for child in known if child.process is not None]
        bury({one.pid for one in running} | self._trials.pids() | self._forks.pids())

    def _keep_lines(self) -> None:
        """Have one process for each line, with the devices the server told last."""
        wanted = lines_of(self._journal.devices())
        for line, devices in wanted.items():
            mark = fingerprint(devices) + marks_of(devices)
            child = self._lines.get(line)
            if child is None:
                child = self._lines[line] = self._child(line, "line", line)
                child.mark(mark, devices)
            elif child.fingerprint != mark and self._has_drained(line):
                log.info("the devices of %s have changed", line)
                child.mark(mark, devices)
                child.leave()
        for line in self._lines.keys() - wanted.keys():
            if not self._journal.is_line_acting(line):
                self._lines.pop(line).tell()
                self._store.forget_line(line)

    def _has_drained(self, line: str) -> bool:
        """Say whether no action waits for a version that the line has and is to lose.

        One that acts does not count: the process leaves only after its end.
        """
        digests = self._lines[line].digests
        target = {device.id: device.digest for device in self._journal.devices()}
        return not any(
            row.do.driver_digest == digests.get(row.device_id) != target.get(row.device_id)
            for row in self._journal.actions(line, ActionState.ACCEPTED)
        )

    def _ring(self) -> None:
        """Ring again for lines that have work, and post a message where none waits."""
        for line in self._journal.waiting_lines():
            if line in self._lines and self._store.queue_length(line_queue(line)) == 0:
                ring(self._config.bell_of(line))
                wake(self._host_app, line)

    def _prune(self) -> None:
        self._journal.prune(self._config.retention_s)

    def _make_services(self) -> list[ChildProcess]:
        """Return what runs beside the lines, the uplink last: it tells of what the others did."""
        uplink = self._child("uplink", "uplink")
        wanted = {
            "accept": bool(self._config.broker_url),
            "discovery": self._config.discovery is not None,
            "ros2": self._config.ros2 is not None,
            "tryouts": self._config.tryouts,
        }
        return [*(self._child(name, name) for name in wanted if wanted[name]), uplink]

    def _child(self, name: str, kind: str, *rest: str) -> ChildProcess:
        orphan_signal = SIGTERM if kind == "line" else SIGKILL
        argv = [kind, str(self._path), *rest]
        return ChildProcess(
            name, lambda: self._forks.fork(orphan_signal, "host.process_main", argv)
        )

    # --- start and end ---

    def _start_valkey(self) -> None:
        if self._valkey is not None:
            (self._config.folder / "valkey").mkdir(exist_ok=True, mode=0o700)
            self._valkey.keep()
        deadline_s = time.monotonic() + VALKEY_START_S
        while not self._store.ping():
            if time.monotonic() > deadline_s:
                raise StateError(f"no Valkey answers at {self._config.valkey_url}")
            self._stopping.wait(0.02)

    def _on_signal(self, *_: object) -> None:
        self._signals_count += 1
        self._stopping.set()
        ring(self._config.supervisor_bell)

    def _on_child(self, *_: object) -> None:
        """Look at once when a process ends: what it tried is told, and another takes its place."""
        ring(self._config.supervisor_bell)

    def _end(self) -> None:
        """End lines and accept first, so that the uplink can still tell of what they did."""
        log.info("host %s ends", self._config.host_id)
        self._trials.end()
        self._forks.end()
        *others, uplink = self._services
        acting = [*self._lines.values(), *others]
        self._end_all(acting, self._config.stop_grace_s + HALT_S)
        self._end_all([uplink], 2.0)
        if self._valkey is not None:
            self._end_all([self._valkey], 2.0)
        self._journal.close()
        self._bell.close()
        os.close(self._lock)

    def _end_all(self, children: list[ChildProcess], patience_s: float) -> None:
        began_s = time.monotonic()
        for child in children:
            child.tell()
        deadline_s = time.monotonic() + patience_s
        while any(child.is_running for child in children):
            if time.monotonic() > deadline_s or self._signals_count > 1:
                for child in children:
                    child.tell(SIGKILL)
            threading.Event().wait(0.02)
        names = ", ".join(child.name for child in children)
        log.info("%s ended after %.2f s", names, time.monotonic() - began_s)


_NOT_OURS = frozenset(
    {
        "DJANGO_SETTINGS_MODULE",
        "BROKER_URL",  # Celery's command line would take it for the broker of every worker
        "CELERY_BROKER_URL",
        "CELERY_BROKER_READ_URL",
        "CELERY_BROKER_WRITE_URL",
        "CELERY_CONFIG_MODULE",
    }
)


def _environment(config: HostConfig) -> dict[str, str]:
    environment = {k: v for k, v in os.environ.items() if k not in _NOT_OURS}
    if config.faults is not None:
        environment |= {"LABWEB_FAULTS": "1", "LABWEB_FAULT": config.faults}
    return environment
