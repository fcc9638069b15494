"""Print the heads of the server's record that this host has countersigned.

    python -m workers.journal.countersigned_heads --config host.json > heads.json

`manage.py verify_audit --heads heads.json`, and `verify_decisions` and `verify_events` alike, hold
the server's record against them. It reads the journal alone, beside a host that runs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from labweb.domain.errors import LabError
from labweb.domain.runs.host_journal.countersigned_heads import META, kept_heads
from workers.base.config import load_config
from workers.journal.journal import Journal


def main(argv: Sequence[str]) -> int:
    """Read the command line; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m workers.journal.countersigned_heads", description=__doc__
    )
    parser.add_argument("--config", type=Path, required=True, help="configuration of the host")
    return print_heads(load_config(parser.parse_args(argv).config).journal_path)


def print_heads(path: Path) -> int:
    """Print the heads in the journal at a path; return the exit code."""
    try:
        journal = Journal(path)
    except LabError as error:
        sys.stderr.write(f"{error.message}\n")
        return 1
    try:
        heads = list(kept_heads(journal.meta(META)).values())
    finally:
        journal.close()
    file = {"format": "labweb heads", "version": 1, "heads": heads, "time_stamps": []}
    sys.stdout.write(msgspec.json.format(msgspec.json.encode(file), indent=1).decode() + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
