"""The liquid of a filter is drawn off below its frit, and what is solid stays on it.

```text
filter: liquor ░░          bottom ──▶ syringe ──▶ flask: liquor
        salt   ▓▓  ══frit═
```
"""

from __future__ import annotations

from dataclasses import replace
from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.resources.contents_by_lot import total_nl
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob, DraftStep
from labweb.domain.workflows.passes.liquids.pump_choice import MOST_STROKES
from labweb.domain.workflows.passes.liquids.solids_drawn_along import meant_solids
from labweb.domain.workflows.passes.liquids.stroke_splitting import count_strokes, split_strokes
from labweb.domain.workflows.passes.liquids.strokes import check_fineness
from labweb.domain.workflows.passes.liquids.syringe_passes import (
    SyringeLine,
    choose_way,
    make_passes,
)
from labweb.domain.workflows.passes.people.stated_at_run import ask_of_solids
from labweb.domain.workflows.workflow_file import Step

BELOW_THE_FRIT = "bottom"
"""Port of a filter that no solid leaves by."""

_AT = "params.stays"


def plan_filter(step: Step, drafting: Drafting) -> DraftStep:
    """Draw all liquid of a filter off at its bottom; the solids that are stated stay.

    Which lots are solid is what the record says of them. Of each a person states how much stays,
    before the run or during it: what is dissolved passes.
    """
    vessel, target = UUID(step.params["vessel"]), UUID(step.params["target"])
    kind, name = drafting.view.tree.find(vessel).kind, drafting.name(vessel)
    if kind != "filter":
        message = f"{name} is a {kind} and no filter: nothing keeps a solid back in it"
        drafting.refuse(step, "plan.no_filter", message, "params.vessel")
        return DraftStep(step=step)
    solids = meant_solids(step, drafting, vessel, "stays")
    amount_nl = total_nl(drafting.contents(vessel))
    if not amount_nl:
        message = f"{name} holds no liquid by then: there is nothing to draw off"
        drafting.refuse(step, "crutd.insufficient_volume", message, "params.vessel")
    if solids is None or not amount_nl:
        return DraftStep(step=step)
    whole = solids.with_liquid(vessel, target, amount_nl)
    chain = choose_way(step, drafting, whole)
    if chain is None or not _leaves_below(step, drafting, chain):
        return DraftStep(step=step, whole=whole)
    asked = [] if solids.later is None else [ask_of_solids(step, drafting, vessel, solids.later)]
    draft = _draw_off(step, drafting, whole, chain, asked)
    if solids.keeps or solids.carries_ug or not draft.jobs:
        return draft
    note = f"{name}: nothing in it is solid by the record, so all of it passes the filter"
    return replace(draft, notes=(*draft.notes, note))


def _draw_off(
    step: Step,
    drafting: Drafting,
    whole: TransferLiquid,
    chain: SyringeLine,
    asked: list[DraftJob | None],
) -> DraftStep:
    nothing = DraftStep(step=step, whole=whole)
    passes = make_passes(step, drafting, chain)
    if passes is None:
        return nothing
    count = count_strokes(whole.amount_nl, passes.stroke_nl)
    if count > MOST_STROKES:
        message = f"it takes {count} strokes; at most {MOST_STROKES} are planned"
        drafting.refuse(step, "plan.too_many_strokes", message, "params.vessel")
        return nothing
    parts = split_strokes(whole.amount_nl, passes.stroke_nl)
    for one in passes.strokes:
        check_fineness(step, drafting, one.device, one.syringe_nl, parts)
    jobs = [*asked, *passes.move_all(whole)]
    made = tuple(job for job in jobs if job is not None)
    if len(made) < len(jobs):
        return nothing
    return DraftStep(step=step, jobs=made, whole=whole, pump_ids=chain.pump_ids, notes=chain.notes)


def _leaves_below(step: Step, drafting: Drafting, chain: SyringeLine) -> bool:
    port = chain.legs[0].route.ports[0].port
    if port == BELOW_THE_FRIT:
        return True
    name = drafting.name(UUID(step.params["vessel"]))
    message = (
        f"the way to {drafting.name(chain.pump_ids[0])} leaves {name} by {port!r}, which is not "
        f"below its frit: solids would come along. Join {BELOW_THE_FRIT!r} to a pump, or name one"
    )
    drafting.refuse(step, "plan.no_filter", message, "params.vessel")
    return False
