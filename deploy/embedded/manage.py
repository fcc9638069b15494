"""Django's commands for a lab that runs."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

from deploy.embedded import procfs, record
from deploy.embedded.errors import EmbeddedError
from deploy.embedded.layout import CHECKOUT, Layout

_NOT_HANDED_ON = {record.MARK, "PYTHONUNBUFFERED"}
"""The mark is left out: Ctrl-C on the lab then ends no command that a person started."""


def environment_of(data: Path) -> dict[str, str]:
    """Give what the processes of a running lab find in their environment.

    Raises:
        EmbeddedError: No lab runs on this data directory, or it belongs to another user.
    """
    last = record.load(Layout(data.resolve()))
    running = last.processes.values() if last and last.url and last.is_running() else []
    for entry in running:
        environment = procfs.environment_of(entry.process.pid)
        if environment.get("LABWEB_DATA") == str(data.resolve()):
            return {k: v for k, v in environment.items() if k not in _NOT_HANDED_ON}
    raise EmbeddedError(
        f"No lab runs on {data}. Start it (make run), or name the data directory of one that "
        "runs with --data"
    )


def manage(data: Path, words: Sequence[str]) -> None:
    """Become Django's command line, with the database and the keys of the lab that runs.

    Raises:
        EmbeddedError: No lab runs on this data directory.
    """
    environment = environment_of(data)
    sys.stdout.flush()
    argv = [sys.executable, str(CHECKOUT / "manage.py"), *words]
    os.execve(sys.executable, argv, environment)  # noqa: S606 - the person's own command
