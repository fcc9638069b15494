"""Command line of the embedded default."""

from __future__ import annotations

import argparse
import json
import math
import signal
import sys
import threading
from pathlib import Path
from types import FrameType

from deploy.embedded import external, procfs, record, room
from deploy.embedded.database_and_broker import clean_environment, services
from deploy.embedded.errors import EmbeddedError
from deploy.embedded.guard import guarded
from deploy.embedded.layout import DEFAULT_LAB, Layout, data_directory_of
from deploy.embedded.manage import manage
from deploy.embedded.processes import table as default_processes
from deploy.embedded.session import Options, ProcessTable, StageTable, run
from deploy.embedded.stages import table as default_stages

FAILED = 1
NOT_RUNNING = 3
"""What `status` returns when nothing runs, as init scripts do."""

_STOP_WITHIN_S = 10.0
_LAST_PORT = 65535
_SERVERS = """\
servers of your own, in the environment; each that is set takes the place of the embedded one:
  DATABASE_URL  PostgreSQL 15 or later: postgresql://user@host:5432/name, an empty database
  REDIS_URL     Redis or Valkey 7 or later: redis://host:6379/0, one database number per lab
  AMQP_URL      RabbitMQ as the broker: amqp://user@host:5672/vhost, one virtual host per lab
"""


def main(
    arguments: list[str] | None = None,
    *,
    process_table: ProcessTable = default_processes,
    stage_table: StageTable = default_stages,
) -> int:
    """Do what the command line asks and return the exit code."""
    given = _parser().parse_args(arguments)
    try:
        if given.command == "check":
            return _check()
        data: Path = given.data or data_directory_of(given.lab)
        if given.command == "run":
            options = Options(
                given.lab,
                data,
                given.bind,
                given.port,
                given.speed,
                not given.no_twin,
                given.edge,
            )
            return guarded(lambda guard: _run(options, guard, process_table, stage_table))
        if given.command == "services":
            return _services(data)
        if given.command == "manage":
            manage(data, given.words)
        return _status(data) if given.command == "status" else _stop(data)
    except EmbeddedError as error:
        sys.stderr.write(f"labweb: {error}\n")
        return FAILED
    except OSError as error:
        if error.errno not in room.SHORTAGES:
            raise
        sys.stderr.write(f"labweb: {error}. Free some space, or let the disk be written, first.\n")
        return FAILED


def _run(options: Options, guard: int, process_table: ProcessTable, stage_table: StageTable) -> int:
    run(options, guard, process_table=process_table, stage_table=stage_table)
    return 0


def _check() -> int:
    """Say of every server, given or embedded, which one a lab would use."""
    given = external.given_urls()
    found = external.reach(given, clean_environment())
    for name, kind in external.NAMES.items():
        own = "none, the broker is Redis" if name == external.AMQP else "embedded"
        line = found[name].line if name in found else f"{kind} … {own}: {name} is not set"
        sys.stdout.write(f"{line}\n")
    return 0


def _services(data: Path) -> int:
    """Run the two servers until a signal."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _leave)
    try:
        with services(data) as urls:
            sys.stdout.write(json.dumps(urls) + "\n")
            sys.stdout.flush()
            threading.Event().wait()
    except SystemExit:
        return 0
    return 0


def _leave(number: int, frame: FrameType | None) -> None:
    del number, frame
    sys.exit(0)


def _status(data: Path) -> int:
    """Say what runs on a data directory."""
    last = record.load(Layout(data.resolve()))
    if last is None or not last.is_running():
        sys.stdout.write(f"Nothing runs on {data}\n")
        return NOT_RUNNING
    sys.stdout.write(f"{last.url or 'services alone'}  process {last.supervisor.pid}\n")
    found = room.look(data)
    if found is not None and (text := room.warning(data, found)):
        sys.stdout.write(f"  {text}\n")
    for name, entry in last.processes.items():
        state = "running" if procfs.is_alive(entry.process) else "ended"
        sys.stdout.write(f"  {name:<14} {entry.process.pid:>7}  {state}\n")
    return 0


def _stop(data: Path) -> int:
    """Ask the supervisor of a data directory to stop, and wait for it."""
    last = record.load(Layout(data.resolve()))
    if last is None or not last.is_running():
        sys.stdout.write(f"Nothing runs on {data}\n")
        return 0
    procfs.send(last.supervisor, signal.SIGTERM)
    if procfs.wait_gone([last.supervisor], _STOP_WITHIN_S):
        sys.stderr.write(
            f"labweb: process {last.supervisor.pid} has not stopped in {_STOP_WITHIN_S:g} s\n"
        )
        return FAILED
    sys.stdout.write("Stopped\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m deploy.embedded",
        description=__doc__,
        epilog=_SERVERS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    for name, text in (
        ("run", "run a lab until Ctrl-C"),
        ("status", "say what runs"),
        ("stop", "stop a running lab"),
        ("services", "run PostgreSQL and Valkey alone and print their addresses as JSON"),
        ("manage", "run one of Django's commands, such as verify_ledger, on a lab that runs"),
        ("check", "say whether the servers that the environment names can be used"),
    ):
        command = commands.add_parser(
            name,
            help=text,
            description=text,
            epilog=_SERVERS if name in {"run", "check"} else None,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if name != "check":
            command.add_argument("--data", type=Path, help="data directory (var/<lab name>)")
            command.add_argument("--lab", type=Path, default=DEFAULT_LAB, help="lab file")
        if name == "run":
            _add_run_options(command)
        if name == "manage":
            command.add_argument("words", nargs=argparse.REMAINDER, help="command and options")
    return parser


def _add_run_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("--bind", type=Path, help="binding of an imported lab")
    command.add_argument("--port", type=_port, default=8400, help="port of the page (8400)")
    command.add_argument(
        "--speed", type=_speed, default=1.0, help="simulated seconds per second (1)"
    )
    command.add_argument(
        "--edge", type=_address, help="address and port for edge hosts of other machines (none)"
    )
    command.add_argument("--no-twin", action="store_true", help="leave the 3D twin out")


def _port(text: str) -> int:
    if not text.isdecimal() or not 0 < int(text) <= _LAST_PORT:
        raise argparse.ArgumentTypeError(f"{text!r} is not a port between 1 and {_LAST_PORT}")
    return int(text)


def _address(text: str) -> str:
    host, _, port = text.rpartition(":")
    if not host:
        raise argparse.ArgumentTypeError(f"{text!r} is no address with a port, as 192.0.2.7:8443")
    return f"{host}:{_port(port)}"


def _speed(text: str) -> float:
    try:
        speed = float(text)
    except ValueError:
        speed = math.nan
    if not (math.isfinite(speed) and speed > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above zero")
    return speed


if __name__ == "__main__":
    sys.exit(main())
