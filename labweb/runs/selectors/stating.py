"""What a person may state of a vessel in the place of a job: the lots that it holds."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from labweb.crutd import selectors as crutd_selectors
from labweb.domain.resources.contents import LotId
from labweb.resources import selectors as resource_selectors
from labweb.runs.models import Job


def to_state(job: Job) -> dict[str, Any] | None:
    """Return what a person states in the place of a job; None: nothing.

    `label` is what they state, `lots` the liquid lots in the vessel that the job asks about: `key`
    is how a step names the lot, `held_ul` how much there is of it, in microlitres. Lots are
    ordered by key.
    """
    if job.states is None:
        return None
    vessel = UUID(job.states["resource_id"])
    held = crutd_selectors.contents([vessel]).get(vessel, {})
    lots = resource_selectors.lots_of(job.run.lab).filter(pk__in=list(held))
    told = [
        {"key": lot.key, "name": str(lot), "held_ul": held[LotId(str(lot.pk))] / 1000}
        for lot in lots.order_by("key")
    ]
    return {"label": job.states["label"], "lots": told}
