"""Django's commands for a lab that runs."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from deploy.embedded import external, procfs, record
from deploy.embedded.errors import EmbeddedError
from deploy.embedded.layout import CHECKOUT, Layout
from deploy.embedded.postgres import APP_ROLE, NAME

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


_BY_OWNER = frozenset({"flush", "grant_database", "migrate", "rebuild"})
"""Commands that change tables, or write the record again from its events."""


def owned(environment: Mapping[str, str], words: Sequence[str]) -> dict[str, str]:
    """Give the environment of a command: as the owner of the tables where it changes them."""
    if not _BY_OWNER.intersection(words[:1]):
        return dict(environment)
    url = environment[external.DATABASE]
    own = external.owner_url() or url.replace(f"//{APP_ROLE}@", f"//{NAME}@", 1)
    return {**environment, external.DATABASE: own}


def manage(data: Path, words: Sequence[str]) -> None:
    """Become Django's command line, with the database and the keys of the lab that runs.

    Raises:
        EmbeddedError: No lab runs on this data directory.
    """
    environment = owned(environment_of(data), words)
    sys.stdout.flush()
    argv = [sys.executable, str(CHECKOUT / "manage.py"), *words]
    os.execve(sys.executable, argv, environment)  # noqa: S606 - the person's own command
