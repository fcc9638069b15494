"""What a person may state of a vessel in the place of a job: the lots that it holds."""

from __future__ import annotations

from uuid import UUID

from labweb.crutd import selectors as crutd_selectors
from labweb.domain.resources.contents_by_lot import LotId, Phase
from labweb.resources import selectors as resource_selectors
from labweb.runs.answers.jobs import LotThere, StatementAsked
from labweb.runs.models import Job


def to_state(job: Job) -> StatementAsked | None:
    """Return what a person states in the place of a job; None: nothing.

    `label` is what they state; `leaves_out` says that with nothing of any lot the step is left
    out; `lots` are those in the vessel that the job asks about: `key` is how a step names the
    lot, `held_ul` how much there is of a liquid, in microlitres, `held_mg` of a solid, in
    milligrams. Lots are ordered by key.
    """
    if job.states is None:
        return None
    vessel = UUID(job.states["resource_id"])
    phases = {Phase(one) for one in job.states.get("phases", [Phase.LIQUID])}
    held = crutd_selectors.amounts([vessel]).get(vessel, {})
    lots = resource_selectors.lots_of(job.run.lab).filter(pk__in=list(held))
    told = []
    for lot in lots.order_by("key"):
        if Phase(lot.phase) not in phases:
            continue
        amount = held[LotId(str(lot.pk))]
        is_liquid = Phase(lot.phase) is Phase.LIQUID
        told.append(
            LotThere(
                key=lot.key,
                name=str(lot),
                held_ul=amount.nl / 1000 if is_liquid else None,
                held_mg=None if is_liquid else amount.ug / 1000,
            )
        )
    leaves_out = job.states.get("leaves_out", True)
    return StatementAsked(label=job.states["label"], leaves_out=leaves_out, lots=told)
