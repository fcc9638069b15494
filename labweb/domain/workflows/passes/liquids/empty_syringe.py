"""A syringe that holds liquid by the record is emptied into a vessel, in one stroke."""

from __future__ import annotations

from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.errors import Finding
from labweb.domain.resources.contents_by_lot import total_nl
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftStep
from labweb.domain.workflows.passes.liquids.pump_choice import find_outlet, pump_node
from labweb.domain.workflows.passes.liquids.strokes import dead_volume_notes, make_strokes
from labweb.domain.workflows.workflow_file import Step


def plan_empty_syringe(step: Step, drafting: Drafting) -> DraftStep:
    """Plan the one stroke that empties a syringe; findings are noted and the jobs left out.

    Only this step leaves a syringe with another amount than the plan began with, and what it
    leaves is nothing. So the amount is what the syringe holds at the beginning, and the ledger
    refuses the step when an earlier one has emptied the syringe already.
    """
    view = drafting.view
    target = UUID(step.params["target"])
    device = view.find_device(UUID(step.params["pump"]))
    pump_id = None if device is None else pump_node(view, device)
    state = None if pump_id is None else view.state(pump_id)
    if device is None or pump_id is None or state is None:
        message = "no device of this lab drives that syringe pump"
        drafting.refuse(step, "plan.no_device", message, "params.pump")
        return DraftStep(step=step)
    held_nl = total_nl(state.contents)
    if held_nl == 0:
        drafting.findings.append(syringe_empty(state.name, step))
        return DraftStep(step=step)
    # Whatever is in a syringe, its plunger drives out.
    solids = {str(lot): ug for lot, ug in drafting.solids(pump_id).items()}
    whole = TransferLiquid(
        source_id=pump_id, target_id=target, amount_nl=held_nl, carries_ug=solids
    )
    leg = find_outlet(view, device, pump_id, target)
    if isinstance(leg, Finding):
        drafting.refuse(step, leg.code, leg.message, "params.target", **leg.context)
        return DraftStep(step=step, whole=whole)
    strokes = make_strokes(step, drafting, device, pump_id)
    jobs = [] if strokes is None else strokes.push(whole, leg)
    made = tuple(job for job in jobs if job is not None)
    if not jobs or len(made) < len(jobs):
        return DraftStep(step=step, whole=whole)
    notes = dead_volume_notes(leg)
    return DraftStep(
        step=step, jobs=made, whole=whole, pump_ids=(pump_id,), empties=True, notes=notes
    )


def syringe_empty(name: str, step: Step) -> Finding:
    """Say that there is nothing to push out."""
    message = f"the syringe of {name} is empty by the record: there is nothing to push out"
    return Finding("plan.syringe_empty", message, step.id, {"field": "params.pump"})
