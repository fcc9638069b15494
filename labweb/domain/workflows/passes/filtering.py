"""The liquid of a filter is drawn off below its frit, and what is solid stays on it.

```text
filter: liquor ░░          bottom ──▶ syringe ──▶ flask: liquor
        salt   ▓▓  ══frit═
```
"""

from __future__ import annotations

from dataclasses import replace
from uuid import UUID

from msgspec import structs

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.resources.contents import LotId, total_nl
from labweb.domain.units import render_mass
from labweb.domain.workflows.passes.chaining import Chain, choose_way, make_passes
from labweb.domain.workflows.passes.draft import Drafting, DraftJob, DraftStep
from labweb.domain.workflows.passes.pumping import MOST_STROKES
from labweb.domain.workflows.passes.splitting import count_strokes, split_strokes
from labweb.domain.workflows.passes.strokes import check_fineness
from labweb.domain.workflows.protocol import Step
from labweb.domain.workflows.unit_operations import ALL

BELOW_THE_FRIT = "bottom"
"""Port of a filter that no solid leaves by."""

_AT = "params.stays"


def plan_filter(step: Step, drafting: Drafting) -> DraftStep:
    """Draw all liquid of a filter off at its bottom; the solids that are stated stay.

    Which lots are solid is what the record says of them. Of each a person states that it stays:
    a solid may be dissolved, and then it passes.
    """
    vessel, target = UUID(step.params["vessel"]), UUID(step.params["target"])
    kind, name = drafting.view.tree.find(vessel).kind, drafting.name(vessel)
    if kind != "filter":
        message = f"{name} is a {kind} and no filter: nothing keeps a solid back in it"
        drafting.refuse(step, "plan.no_filter", message, "params.vessel")
        return DraftStep(step=step)
    keeps = _stated_solids(step, drafting, vessel)
    amount_nl = total_nl(drafting.contents(vessel))
    if not amount_nl:
        message = f"{name} holds no liquid by then: there is nothing to draw off"
        drafting.refuse(step, "crutd.insufficient_volume", message, "params.vessel")
    if keeps is None or not amount_nl:
        return DraftStep(step=step)
    whole = TransferLiquid(source_id=vessel, target_id=target, amount_nl=amount_nl, keeps=keeps)
    chain = choose_way(step, drafting, whole)
    if chain is None or not _leaves_below(step, drafting, chain):
        return DraftStep(step=step, whole=whole)
    draft = _draw_off(step, drafting, whole, chain)
    if keeps or not draft.jobs:
        return draft
    note = f"{name}: nothing in it is solid by the record, so all of it passes the filter"
    return replace(draft, notes=(*draft.notes, note))


def _draw_off(step: Step, drafting: Drafting, whole: TransferLiquid, chain: Chain) -> DraftStep:
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
    jobs: list[DraftJob | None] = []
    for place, part_nl in enumerate(parts, start=1):
        text = f", stroke {place} of {len(parts)}" if len(parts) > 1 else ""
        jobs += passes.move(structs.replace(whole, amount_nl=part_nl), text)
    made = tuple(job for job in jobs if job is not None)
    if len(made) < len(jobs):
        return nothing
    return DraftStep(step=step, jobs=made, whole=whole, pump_ids=chain.pump_ids, notes=chain.notes)


def _leaves_below(step: Step, drafting: Drafting, chain: Chain) -> bool:
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


def _stated_solids(step: Step, drafting: Drafting, vessel: UUID) -> tuple[UUID, ...] | None:
    """Return the solid lots that stay, all of each; None: not all are stated, which is noted."""
    name, held = drafting.name(vessel), drafting.solids(vessel)
    stated: set[LotId] = set()
    is_whole = True
    for key, much in sorted(step.params.get("stays", {}).items()):
        lot = drafting.lot(key)
        if lot is None:
            drafting.refuse(step, "plan.no_lot", f"this lab has no lot {key!r}", _AT, lot=key)
        elif lot not in held:
            message = f"{name} holds no solid {key} by then, which could stay on it"
            drafting.refuse(step, "crutd.insufficient_mass", message, _AT, lot=key)
        elif much != ALL:
            message = f"of {key} all stays or none: no step moves what would pass of a solid"
            drafting.refuse(step, "plan.solid_not_stated", message, _AT, lot=key)
        else:
            stated.add(lot)
            continue
        is_whole = False
    for lot in sorted(held.keys() - stated) if is_whole else ():
        message = (
            f"{name} holds {render_mass(held[lot])} of {drafting.key_of(lot)} by then, and nobody "
            f"says that it stays on the filter: state it, or take stock of what became of it first"
        )
        drafting.refuse(step, "plan.solid_not_stated", message, _AT, lot=drafting.key_of(lot))
        is_whole = False
    return tuple(UUID(lot) for lot in sorted(stated)) if is_whole else None
