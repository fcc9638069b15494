"""Run an edge host: `python -m workers.host --config host.json`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from labweb.domain.errors import LabError
from workers.base import logs
from workers.base.config import load_config
from workers.base.host_key import create_key
from workers.host.supervisor import HostSupervisor
from workers.journal.journal_reset import reset_journal


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
        HostSupervisor(config, arguments.config.resolve()).run()
    except LabError as error:
        sys.stderr.write(f"{error.code}: {error.message}\n")
        return 1
    return 0


def _say(text: str) -> int:
    sys.stdout.write(f"{text}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
