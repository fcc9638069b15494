"""A Transfer becomes strokes: turn the valve, aspirate, turn the valve, dispense."""

from __future__ import annotations

from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.resources.contents_by_lot import total_nl
from labweb.domain.units import parse_volume_nl, render_volume
from labweb.domain.workflows.passes.confirmation import MAY_STAY_UNCONFIRMED, may_confirm
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftStep, MassCheck
from labweb.domain.workflows.passes.liquids.pump_choice import MOST_STROKES
from labweb.domain.workflows.passes.liquids.solids_drawn_along import meant_solids
from labweb.domain.workflows.passes.liquids.stroke_splitting import count_strokes, split_strokes
from labweb.domain.workflows.passes.liquids.strokes import check_fineness
from labweb.domain.workflows.passes.liquids.syringe_passes import choose_way, make_passes
from labweb.domain.workflows.passes.people.stated_at_run import ask_of_solids
from labweb.domain.workflows.passes.role_requirements import plays
from labweb.domain.workflows.unit_operations.unit_operation import ALL
from labweb.domain.workflows.workflow_file import Step


def plan_transfer(step: Step, drafting: Drafting) -> DraftStep:
    """Plan the strokes of one Transfer; findings are noted and the jobs left out."""
    source, target = UUID(step.params["source"]), UUID(step.params["target"])
    is_all = step.params["volume"] == ALL
    amount_nl = total_nl(drafting.contents(source)) if is_all else 0
    if is_all and not amount_nl:
        message = f"{drafting.name(source)} is empty by then: there is nothing to move"
        drafting.refuse(step, "crutd.insufficient_volume", message, "params.volume")
        # Whether there is a way is known all the same, and said with it.
        choose_way(step, drafting, TransferLiquid(source_id=source, target_id=target, amount_nl=1))
        return DraftStep(step=step)
    amount_nl = amount_nl or parse_volume_nl(step.params["volume"])
    if source == target:
        message = "source and target are the same vessel"
        drafting.refuse(step, "crutd.same_vessel", message, "params.target")
        return DraftStep(step=step)
    solids = meant_solids(step, drafting, source, "solids")
    if solids is None:
        return DraftStep(step=step)
    whole = solids.with_liquid(source, target, amount_nl)
    mass_check = _mass_check(step, drafting, target)
    chain = choose_way(step, drafting, whole)
    passes = None if chain is None else make_passes(step, drafting, chain, mass_check)
    if passes is None:
        return DraftStep(step=step, whole=whole)
    count = count_strokes(amount_nl, passes.stroke_nl)
    if count > MOST_STROKES:
        message = (
            f"{render_volume(amount_nl)} takes {count} strokes of "
            f"{render_volume(passes.stroke_nl)}; at most {MOST_STROKES} are planned"
        )
        drafting.refuse(step, "plan.too_many_strokes", message, "params.volume")
        return DraftStep(step=step, whole=whole)
    parts = split_strokes(amount_nl, passes.stroke_nl)
    for one in passes.strokes:
        check_fineness(step, drafting, one.device, one.syringe_nl, parts)
    jobs = passes.move_all(whole)
    if solids.later is not None:
        jobs.insert(0, ask_of_solids(step, drafting, source, solids.later))
    if None in jobs:
        return DraftStep(step=step, whole=whole)
    return DraftStep(
        step=step,
        jobs=tuple(job for job in jobs if job is not None),
        whole=whole,
        pump_ids=passes.chain.pump_ids,
        notes=passes.chain.notes,
    )


def _mass_check(step: Step, drafting: Drafting, target: UUID) -> MassCheck | None:
    if not may_confirm(step, drafting):
        return None
    view, at = drafting.view, "params.confirm_with"
    balance = view.find_device(UUID(step.params["confirm_with"]))
    if balance is None or not plays(balance, "balance"):
        drafting.refuse(step, "plan.no_device", "no device of this lab drives that balance", at)
        return None
    nodes = set(balance.nodes.values())
    carrier = next((r for r in view.tree.ancestors(target) if r.id in nodes), None)
    if carrier is None:
        message = f"{drafting.name(target)} does not stand on {balance.name}"
        drafting.refuse(step, "plan.not_on_balance", message, at)
        return None
    is_free = step.params.get(MAY_STAY_UNCONFIRMED) is True
    return MassCheck(balance=balance, node_id=carrier.id, may_stay_unconfirmed=is_free)
