"""PostgreSQL and Valkey together: started, waited for, addressed, stopped."""

from __future__ import annotations

import os
import subprocess
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from signal import Signals
from time import monotonic

from deploy.embedded import external, leftovers, record
from deploy.embedded.children import (
    Process,
    describe_exit,
    identity_of,
    last_lines,
    spawn,
)
from deploy.embedded.errors import EmbeddedError
from deploy.embedded.layout import (
    Layout,
    close_sockets,
    lock,
    open_data_directory,
    open_sockets,
)
from deploy.embedded.postgres import APP_ROLE, Postgres
from deploy.embedded.valkey import Valkey

READY_TIMEOUT_S = 60.0
_POLL_S = 0.02
_STOP_S = 3.0
_LEAVE_S = 6.0
"""A lab that was told to stop has left its data directory by then."""


class Stack:
    """The servers of one data directory: two of its own, less what the person gives."""

    def __init__(
        self,
        layout: Layout,
        sockets: Path,
        *,
        durable: bool = True,
        given: Mapping[str, str] | None = None,
    ) -> None:
        """Choose programs and addresses; nothing is started.

        Args:
            layout: Where they work.
            sockets: A private folder with a short path.
            durable: False gives up safety against power loss, for tests.
            given: Addresses of the person's own servers (see `external`).
        """
        self.layout = layout
        self._given = dict(given or {})
        log = layout.logs / "postgresql.log"
        self.postgres = (
            None
            if external.DATABASE in self._given
            else Postgres(layout.cluster, sockets, log, durable=durable)
        )
        self.valkey = (
            None
            if external.REDIS in self._given
            else Valkey(layout.broker, sockets, durable=durable)
        )

    @property
    def urls(self) -> dict[str, str]:
        """Give the addresses as the environment variables that labweb reads."""
        found: dict[str, str] = {}
        if self.postgres is not None:
            found[external.DATABASE] = self.postgres.url
        if self.valkey is not None:
            found[external.REDIS] = self.valkey.url
            found[external.BROKER] = self.valkey.broker_url
        return found | self.given_urls

    @property
    def app_urls(self) -> dict[str, str]:
        """Give the same addresses for the lab's processes, which own nothing of our database."""
        if self.postgres is None:
            return self.urls
        return self.urls | {external.DATABASE: self.postgres.app_url}

    @property
    def owner_url(self) -> str:
        """Give the address of the database for the owner of its tables."""
        return external.owner_url() or self.urls[external.DATABASE]

    @property
    def app_role(self) -> str | None:
        """Give the role of the lab's processes; None: they sign in as the owner of the tables."""
        if self.postgres is not None:
            return APP_ROLE
        role = external.role_of(self.app_urls[external.DATABASE])
        return role if role and external.owner_url() else None

    @property
    def given_urls(self) -> dict[str, str]:
        """Give those of the addresses that are the person's own."""
        return external.urls_for_children(self._given)

    @property
    def servers(self) -> tuple[Valkey | Postgres, ...]:
        """List what is started here, in the order of the start."""
        return tuple(server for server in (self.valkey, self.postgres) if server is not None)

    def log_of(self, process: Process) -> Path:
        """Name the file that a process writes to."""
        return self.layout.logs / f"{process.name}.log"


def clean_environment() -> dict[str, str]:
    """Copy this process's environment without what would mislead a child."""
    misleading = {
        *("PYTHONDONTWRITEBYTECODE", "NOTIFY_SOCKET"),
        *(external.BROKER, external.OWNER, *external.NAMES),
    }
    return {
        name: value
        for name, value in os.environ.items()
        if name not in misleading and not name.startswith("PG")
    }


def wait_ready(
    name: str,
    is_ready: Callable[[], bool],
    has_ended: Callable[[], int | None],
    log: Path,
    pause: Callable[[float], object],
) -> None:
    """Wait until a server answers.

    Raises:
        EmbeddedError: It ended, or did not answer in time; its last lines are in the message.
    """
    deadline = monotonic() + READY_TIMEOUT_S
    while not is_ready():
        code = has_ended()
        if code is None and monotonic() < deadline:
            pause(_POLL_S)
            continue
        why = f"did not answer in {READY_TIMEOUT_S:g} s" if code is None else describe_exit(code)
        said = "\n  ".join(last_lines(log, 5))
        raise EmbeddedError(f"{name} did not start: {why}. {log} ends with:\n  {said}")


def claim(layout: Layout) -> int:
    """Lock the data directory and end what a killed run left in it.

    Raises:
        EmbeddedError: Another run has it; the message names its process and address.
    """
    deadline = monotonic() + _LEAVE_S
    descriptor, last = lock(layout), record.load(layout)
    while descriptor is None and not (last and last.is_running()) and monotonic() < deadline:
        # Its guard was killed and the supervisor is still ending the rest, or it has ended it
        # and is about to leave; one that begins says so in its record at once.
        threading.Event().wait(_POLL_S)
        descriptor, last = lock(layout), record.load(layout)
    if descriptor is None:
        holder = f"process {last.supervisor.pid}" if last else "another process"
        place = f" at {last.url}" if last and last.url else ""
        raise EmbeddedError(
            f"{layout.data} is in use by {holder}{place}. Stop that one first "
            f"(python -m deploy.embedded stop --data {layout.data}), or choose another "
            "data directory with --data."
        )
    if last is not None:
        leftovers.end(last)
        record.forget(layout)
    return descriptor


@contextmanager
def services(data: Path | str, *, durable: bool = True) -> Iterator[dict[str, str]]:
    """Run PostgreSQL and Valkey for the length of a with block.

    Enter it from the main thread. Both also end when this process is killed.

    Args:
        data: Data directory, new or of an earlier run; what it holds is kept.
        durable: False is faster and gives up safety against power loss, for tests.

    Yields:
        ``DATABASE_URL``, ``REDIS_URL`` and ``LABWEB_BROKER_URL``.

    Raises:
        EmbeddedError: They cannot start here; nothing is left running.
    """
    layout = open_data_directory(Path(data))
    descriptor = claim(layout)
    running: list[tuple[Process, subprocess.Popen[bytes]]] = []
    try:
        stack = Stack(layout, open_sockets(layout), durable=durable)
        _start(stack, running)
        yield stack.urls
    finally:
        for process, popen in running:
            _stop(process, popen)
        close_sockets(layout)
        record.forget(layout)
        os.close(descriptor)


def _start(stack: Stack, running: list[tuple[Process, subprocess.Popen[bytes]]]) -> None:
    book = record.begin(os.getpid())
    environment = clean_environment() | {record.MARK: book.token}
    pause = threading.Event().wait
    for server in stack.servers:
        if isinstance(server, Postgres):
            server.prepare(environment)
        process = server.process()
        log = stack.log_of(process)
        popen = spawn(process, environment=environment, log=log, folder=stack.layout.data)
        running.append((process, popen))
        if identity := identity_of(popen):
            book.processes[process.name] = record.ProcessEntry(identity, process.orphan_signal)
        book.save(stack.layout)
    for server, (process, popen) in zip(stack.servers, running, strict=True):
        wait_ready(process.name, server.is_ready, popen.poll, stack.log_of(process), pause)


def _stop(process: Process, popen: subprocess.Popen[bytes]) -> None:
    for number in (process.stop_signal, process.orphan_signal, Signals.SIGKILL):
        popen.send_signal(number)
        with suppress(subprocess.TimeoutExpired):
            popen.wait(_STOP_S)
            return
