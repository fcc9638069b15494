"""Resources still quarantined though their transaction is over."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from labweb.crutd.models import Transaction
from labweb.domain.crutd.transaction_states import FINAL
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab, Resource


@dataclass(frozen=True, slots=True)
class GivenUp:
    """A resource still quarantined though its transaction is over."""

    resource: Resource
    at: datetime


def given_up(lab: Lab) -> list[GivenUp]:
    """Return what nobody can answer for any more, oldest first; two queries at most.

    Only taking stock tells what these hold.
    """
    closed = resource_selectors.resources_of(lab).filter(quarantined_by__isnull=False)
    rows = {row.id: row for row in closed}
    if not rows:
        return []
    over = Transaction.objects.filter(
        pk__in={row.quarantined_by for row in rows.values()},
        state__in=[state.value for state in FINAL],
        settled_at__isnull=False,
    )
    ends = {pk: at for pk, at in over.values_list("pk", "settled_at") if at is not None}
    found = [
        GivenUp(row, ends[row.quarantined_by])
        for row in rows.values()
        if row.quarantined_by in ends
    ]
    return sorted(found, key=lambda one: one.at)
