"""Which databases a data directory goes with: keys, passwords and journals lie beside them.

A given database that already holds a lab is used only from the data directory where that lab
was made. From any other one, nobody could sign in, and two edge hosts would act as one.
"""

from __future__ import annotations

import json

from deploy.embedded.errors import EmbeddedError
from deploy.embedded.external import DATABASE, FoundService
from deploy.embedded.layout import Layout, read_json, write_private


def check(layout: Layout, database: FoundService) -> None:
    """See to it that a given database is empty or goes with this data directory.

    Raises:
        EmbeddedError: It holds the lab of another data directory.
    """
    if database.is_empty or database.identity in _known(layout):
        return
    if not layout.databases.exists() and layout.stages.exists():
        # A lab that was here before, whose owner says so by removing the list.
        return
    hint = ""
    if layout.stages.exists():
        hint = f" If it is this lab's own, moved or restored, remove {layout.databases}."
    raise EmbeddedError(
        f"{DATABASE}: {database.place} holds a lab, and not the one of {layout.data}. Give it an "
        f"empty database, or run that lab from its own data directory with --data.{hint}"
    )


def remember(layout: Layout, identity: str) -> None:
    """Write down that a database goes with this data directory, before it is filled."""
    known = _known(layout)
    if identity not in known:
        write_private(layout.databases, json.dumps([*known, identity]) + "\n")


def _known(layout: Layout) -> list[str]:
    found = read_json(layout.databases)
    return [str(one) for one in found] if isinstance(found, list) else []
