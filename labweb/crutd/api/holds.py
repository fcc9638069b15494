"""Tell which runs keep a thing for themselves."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

from labweb.crutd.answers import ResourceKeeper
from labweb.crutd.selectors.run_holds import live_on
from labweb.domain.runs.exclusive_use.run_holds import UseMode

_SHARED = {UseMode.DRAW.value, UseMode.POUR.value}


def keepers_of(ids: Iterable[UUID]) -> dict[UUID, list[ResourceKeeper]]:
    """Return the runs that hold things now, by thing; one query."""
    found: dict[UUID, list[ResourceKeeper]] = {}
    for row in live_on(list(ids)):
        found.setdefault(row.resource_id, []).append(
            ResourceKeeper(
                run_id=row.run_id,
                run=row.run_number,
                until_step=row.until_step,
                is_shared=row.mode in _SHARED,
            )
        )
    return found
