"""Two layers part, and the lower one is drawn out at the bottom.

```text
separator: ether ▒▒   wait    bottom ──▶ syringe ──▶ waste: brine
           brine ██  ──────▶  ether stays
```
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.errors import UnitError
from labweb.domain.resources.contents_by_lot import LotId, Phase, total_nl
from labweb.domain.units import parse_volume_nl, render_volume
from labweb.domain.workflows.passes.devices.heat_stir_wait_measure import wait_job
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftStep
from labweb.domain.workflows.passes.liquids.solids_drawn_along import stated_masses
from labweb.domain.workflows.passes.liquids.syringe_passes import choose_way, make_passes
from labweb.domain.workflows.passes.people.stated_at_run import ask_to_state, half_of, left_open
from labweb.domain.workflows.unit_operations.unit_operation import ALL, StepParameter
from labweb.domain.workflows.workflow_file import Step


def plan_separate(step: Step, drafting: Drafting) -> DraftStep:
    """Wait until the layers have parted, then draw what the person says the lower one is.

    Which lots lie in which layer is stated, never inferred: before the run, or during it. What
    is drawn beyond or short of the boundary, a device does not see: the record follows what was
    stated.
    """
    vessel, target = UUID(step.params["vessel"]), UUID(step.params["target"])
    layer = _meant_layer(step, drafting, vessel, target)
    if layer is None:
        return DraftStep(step=step)
    later, whole = layer
    chain = choose_way(step, drafting, whole)
    passes = None if chain is None else make_passes(step, drafting, chain)
    if passes is None:
        return DraftStep(step=step, whole=whole)
    name = drafting.name(vessel)
    text = f"Let the layers in {name} part"
    jobs = [wait_job(step, drafting, (vessel,), sentence=text, duration="settle_for")]
    if later:
        question = f"Which lots lie in the lower layer of {name}, and how much of each?"
        both = (Phase.LIQUID, Phase.SOLID)
        jobs.insert(0, ask_to_state(step, drafting, vessel, later, question, both))
    jobs += passes.move_all(whole)
    if None in jobs:
        return DraftStep(step=step, whole=whole)
    return DraftStep(
        step=step,
        jobs=tuple(job for job in jobs if job is not None),
        whole=whole,
        pump_ids=passes.chain.pump_ids,
        notes=(*passes.chain.notes, *_left_above(step, drafting, whole)),
    )


def _left_above(step: Step, drafting: Drafting, whole: TransferLiquid) -> list[str]:
    """Say which solids stay because the layer, as it is stated, does not name them."""
    named = {drafting.lot(key) for key in step.params.get("lower", {})}
    left = [drafting.key_of(lot) for lot in map(LotId, map(str, whole.keeps)) if lot not in named]
    name = drafting.name(whole.source_id)
    return [f"{name}: {key} is solid and stays, as the lower layer is stated" for key in left]


def _meant_layer(
    step: Step, drafting: Drafting, vessel: UUID, target: UUID
) -> tuple[StepParameter | None, TransferLiquid] | None:
    """Return the move of the lower layer, and what of it is open; None: that is refused.

    A solid lies in it as far as it is stated, dissolved; what is not stated of it stays.
    """
    there, solids = drafting.solids(vessel), dict[LotId, int]()
    later = left_open(step)
    if later is None:
        told = step.params["lower"]
        masses = {key: text for key, text in told.items() if drafting.lot(key) in there}
        found = stated_masses(step, drafting, vessel, "lower", masses)
        lots = _volumes(step, drafting, vessel, "lower", told.keys() - masses.keys())
        if found is None or lots is None:
            return None
        solids = found
    else:
        lots = half_of(step, drafting, vessel)
        solids = {lot: ug // 2 for lot, ug in there.items()}
    if lots is None:
        return None
    whole = TransferLiquid(
        source_id=vessel,
        target_id=target,
        amount_nl=total_nl(lots),
        parts_nl={str(lot): part for lot, part in lots.items()},
        keeps=tuple(UUID(lot) for lot in sorted(there) if not solids.get(lot)),
        carries_ug={str(lot): ug for lot, ug in sorted(solids.items()) if ug},
    )
    return later, whole


def meant_lots(
    step: Step, drafting: Drafting, vessel: UUID, field: str
) -> tuple[StepParameter | None, Mapping[LotId, int] | None]:
    """Return what a step means of the lots of a vessel: what it states, else half of each.

    Returns:
        The parameter that a person states during the run; None: it is stated. And how much of
        each lot; None: that is refused.
    """
    later = left_open(step)
    if later is None:
        return None, stated_lots(step, drafting, vessel, field)
    return later, half_of(step, drafting, vessel)


def stated_lots(
    step: Step, drafting: Drafting, vessel: UUID, field: str
) -> Mapping[LotId, int] | None:
    """Read what a step states of the liquids of a vessel: an amount, or all there is by then."""
    return _volumes(step, drafting, vessel, field, step.params[field].keys())


def _volumes(
    step: Step, drafting: Drafting, vessel: UUID, field: str, keys: Collection[str]
) -> Mapping[LotId, int] | None:
    held, at = drafting.contents(vessel), f"params.{field}"
    found: dict[LotId, int] = {}
    if not keys:
        drafting.refuse(step, "plan.no_lot", "name at least one liquid lot", at)
        return None
    for key in sorted(keys):
        text, lot = step.params[field][key], drafting.lot(key)
        if lot is None:
            drafting.refuse(step, "plan.no_lot", f"this lab has no lot {key!r}", at, lot=key)
            continue
        there = held.get(lot, 0)
        try:
            amount_nl = there if text == ALL else parse_volume_nl(text)
        except UnitError as error:
            drafting.refuse(step, error.code, f"{key}: {error.message}", at, lot=key)
            continue
        if amount_nl > there or not there:
            message = f"{drafting.name(vessel)} holds {render_volume(there)} of {key} by then"
            drafting.refuse(step, "crutd.insufficient_volume", message, at, lot=key)
            continue
        found[lot] = amount_nl
    return found if len(found) == len(keys) else None
