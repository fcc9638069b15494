"""Gas goes through a syringe into a vessel: what is left in the tube to it goes in as well."""

from __future__ import annotations

from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.units import parse_volume_nl, render_volume
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob, DraftStep
from labweb.domain.workflows.passes.liquids.pump_choice import MOST_STROKES
from labweb.domain.workflows.passes.liquids.stroke_splitting import count_strokes, split_strokes
from labweb.domain.workflows.passes.liquids.syringe_passes import choose_way, make_passes
from labweb.domain.workflows.workflow_file import Step


def plan_push_gas(step: Step, drafting: Drafting) -> DraftStep:
    """Plan the strokes that draw a gas and push it into a vessel; no liquid is booked.

    The syringe must be empty by the record before each stroke.
    """
    gas, target = UUID(step.params["gas"]), UUID(step.params["target"])
    amount_nl = parse_volume_nl(step.params["volume"])
    if not drafting.view.tree.find(gas).config.get("gas"):
        message = f"{drafting.name(gas)} does not say which gas it gives"
        drafting.refuse(step, "plan.no_gas", message, "params.gas")
        return DraftStep(step=step)
    whole = TransferLiquid(source_id=gas, target_id=target, amount_nl=amount_nl)
    chain = choose_way(step, drafting, whole)
    passes = None if chain is None else make_passes(step, drafting, chain, is_gas=True)
    if passes is None:
        return DraftStep(step=step)
    if count_strokes(amount_nl, passes.stroke_nl) > MOST_STROKES:
        message = f"{render_volume(amount_nl)} of gas takes more than {MOST_STROKES} strokes"
        drafting.refuse(step, "plan.too_many_strokes", message, "params.volume")
        return DraftStep(step=step)
    jobs: list[DraftJob | None] = []
    for part_nl in split_strokes(amount_nl, passes.stroke_nl):
        jobs += passes.move(TransferLiquid(source_id=gas, target_id=target, amount_nl=part_nl))
    made = tuple(job for job in jobs if job is not None)
    if len(made) < len(jobs):
        return DraftStep(step=step)
    return DraftStep(step=step, jobs=made, pump_ids=passes.chain.pump_ids)
