"""One run of a lab from start to stop."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic

from deploy.embedded import belongs, external, processes, record, stages
from deploy.embedded.children import Process, last_lines
from deploy.embedded.console import Console, welcome
from deploy.embedded.database_and_broker import Stack, claim, clean_environment, wait_ready
from deploy.embedded.errors import EmbeddedError
from deploy.embedded.health import Health
from deploy.embedded.layout import (
    close_sockets,
    ensure_secret_key,
    open_data_directory,
    open_sockets,
)
from deploy.embedded.processes import HOST, Site
from deploy.embedded.supervise import StopRequestError, Supervisor

LATE_START_S = 10.0
"""What starts after web starts by then at the latest, so that a broken page stops no device."""

ProcessTable = Callable[[Site], list[Process]]
StageTable = Callable[[Site], list[stages.Stage]]


@dataclass(frozen=True, slots=True)
class Options:
    """What the person asked for."""

    lab: Path
    data: Path
    bind: Path | None = None
    port: int = 8400
    speed: float = 1.0
    with_twin: bool = True
    edge: str | None = None


@dataclass(frozen=True, slots=True)
class Servers:
    """What database and broker the lab has."""

    stack: Stack
    found: Mapping[str, external.FoundService]
    """The person's own, by variable."""


@dataclass(frozen=True, slots=True)
class Tables:
    """What the lab is made of."""

    processes: ProcessTable
    stages: StageTable


def run(
    options: Options,
    guard: int,
    *,
    process_table: ProcessTable = processes.table,
    stage_table: StageTable = stages.table,
    console: Console | None = None,
) -> None:
    """Run a lab until a signal ends it.

    Args:
        options: The lab and how to run it.
        guard: Process id of the guard above this process (see `guard.guarded`).
        process_table: Which processes make up the lab.
        stage_table: What must happen once before them.
        console: Where to write; None means standard output.

    Raises:
        EmbeddedError: It cannot start; whatever had started was ended again.
    """
    console = console or Console()
    for path in filter(None, (options.lab, options.bind)):
        if not path.is_file():
            raise EmbeddedError(f"There is no file {path}.")
    layout = open_data_directory(options.data, options.lab)
    descriptor = claim(layout)
    try:
        _check_port(options.port)
        given = external.given_urls()
        found = external.reach(given, clean_environment())
        if external.DATABASE in found:
            belongs.check(layout, found[external.DATABASE])
        ensure_secret_key(layout)
        site = Site(
            layout,
            open_sockets(layout),
            lab=options.lab.resolve(),
            bind=options.bind.resolve() if options.bind else None,
            port=options.port,
            speed=options.speed,
            with_twin=options.with_twin,
            edge=options.edge,
        )
        stack = Stack(site.layout, site.sockets, given=given)
        site = replace(site, database_role=stack.app_role)
        servers = Servers(stack, found)
        _Session(site, servers, guard, console, Tables(process_table, stage_table)).run()
    finally:
        record.forget(layout)
        close_sockets(layout)
        os.close(descriptor)


class _Session:
    """The steps of a start, and the supervision after it."""

    def __init__(
        self, site: Site, servers: Servers, guard: int, console: Console, tables: Tables
    ) -> None:
        self._site = site
        self._console = console
        self._stack = servers.stack
        self._found = servers.found
        self._tables = tables
        book = record.begin(guard)
        book.url, book.lab, book.speed = site.url, str(site.lab), site.speed
        self._environment = processes.environment(site, self._stack.app_urls, book.token)
        self._supervisor = Supervisor(site.layout, book, console)

    def run(self) -> None:
        """Start, supervise and stop, whatever happens in between."""
        health = Health(HOST, self._site.port, self._supervisor.wake)
        try:
            self._start_servers()
            self._run_stages()
            self._open(health)
            self._supervisor.watch()
        except StopRequestError:
            self._console.line("Stopping")
        finally:
            health.end()
            began = monotonic()
            self._supervisor.stop()
            self._console.line(f"Stopped in {monotonic() - began:.1f} s")

    def _start_servers(self) -> None:
        valkey, postgres = self._stack.valkey, self._stack.postgres
        environment: Mapping[str, str] = clean_environment() | {
            record.MARK: self._environment[record.MARK]
        }
        for server in self._found.values():
            self._console.line(server.line)
        if self._site.database_role is None:
            self._console.line(
                f"The role of {external.DATABASE} owns the tables, and could rewrite the record. "
                f"Name another role there, and the owner's address in {external.OWNER}"
            )
        if valkey is not None:
            self._supervisor.start(valkey.process(), environment)
        if postgres is not None:
            with self._console.stage("PostgreSQL"):
                postgres.prepare(environment)
                self._supervisor.start(postgres.process(), environment)
                self._wait_ready("postgresql", postgres.is_ready)
        if valkey is not None:
            with self._console.stage("Valkey"):
                self._wait_ready("valkey", valkey.is_ready)

    def _wait_ready(self, name: str, is_ready: Callable[[], bool]) -> None:
        log = self._supervisor.log_of(name)
        ended = self._supervisor.exit_code
        wait_ready(name, is_ready, lambda: ended(name), log, self._supervisor.pause)

    def _run_stages(self) -> None:
        postgres = self._stack.postgres
        database = (
            self._found[external.DATABASE].identity
            if postgres is None
            else postgres.system_identifier()
        )
        belongs.remember(self._site.layout, database)
        ledger = stages.Ledger(self._site.layout.stages, database, self._stack.given_urls)
        for stage in self._tables.stages(self._site):
            if ledger.is_done(stage):
                self._console.line(f"{stage.name} … unchanged")
                continue
            with self._console.stage(stage.name, "done"):
                self._run_stage(stage)
            ledger.enter(stage)

    def _run_stage(self, stage: stages.Stage) -> None:
        name = stage.name.lower().replace(" ", "-")
        environment = self._environment
        if stage.as_owner:
            environment = environment | {external.DATABASE: self._stack.owner_url}
        code = self._supervisor.run_stage(name, stage.argv, environment)
        log = self._supervisor.log_of(name)
        if code != 0:
            said = "\n  ".join(last_lines(log, 12))
            raise EmbeddedError(
                f"The stage '{stage.name}' failed with code {code}. {log} ends with:\n  {said}"
            )
        missing = [str(path) for path in stage.makes if not path.exists()]
        if missing:
            raise EmbeddedError(f"The stage '{stage.name}' did not write {', '.join(missing)}.")

    def _open(self, health: Health) -> None:
        """Start every process, and say so once web answers."""
        table = self._tables.processes(self._site)
        late = [process for process in table if process.after_web]
        for process in table:
            if not process.after_web:
                self._supervisor.start(process, self._environment)
        health.start()
        with self._console.stage("Web"):
            late_at_s = monotonic() + LATE_START_S
            while not health.has_answered():
                self._supervisor.pause(max(0.0, min(1.0, late_at_s - monotonic())) or 1.0)
                if late and monotonic() >= late_at_s:
                    self._start_all(late)
            self._start_all(late)
        self._console.box(welcome(self._site))
        self._console.open_browser(self._site.url)

    def _start_all(self, waiting: list[Process]) -> None:
        while waiting:
            self._supervisor.start(waiting.pop(0), self._environment)


def _check_port(port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise EmbeddedError(
                f"Port {port} of {HOST} cannot be used: {error.strerror}. "
                f"Choose another, for example: make run PORT={_another(port)}"
            ) from error


def _another(port: int) -> int:
    return 8100 if port != 8100 else 8400
