"""A device takes a thing, with all that stands in it, from where it stands to another place."""

from __future__ import annotations

from uuid import UUID

import msgspec

from labweb.domain.crutd.operations import TransferResource
from labweb.domain.errors import NotFoundError
from labweb.domain.graph.attachments import check_loose, find_attachments
from labweb.domain.resources.placement import check_standing, sites_of
from labweb.domain.workflows.passes.confirmation import MAY_STAY_UNCONFIRMED, may_confirm
from labweb.domain.workflows.passes.devices.camera_witness import witness
from labweb.domain.workflows.passes.devices.heat_stir_wait_measure import draft_of
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftStep
from labweb.domain.workflows.unit_operations.step_palette import CARRIED_KINDS
from labweb.domain.workflows.workflow_file import Step

CARRYING = {
    "arm": ("run_program",),
    "storage": ("store_plate", "retrieve_plate"),
}
"""By role: the actions that carry something."""

CARRY_S = 60.0
"""Estimate, unless the driver allows less."""


def plan_carry(step: Step, drafting: Drafting) -> DraftStep:
    """Call the action that carries it; the record moves it when the device has answered.

    What the action does, whoever taught it to the device knows: the step says it. Cameras may
    guard it and confirm it. Where two hosts have to hand the thing over is found when the job
    is dispatched.
    """
    view = drafting.view
    device = view.find_device(UUID(step.params["device"]))
    if device is None:
        message = "nothing drives that resource in this lab"
        drafting.refuse(step, "plan.no_device", message, "params.device")
        return DraftStep(step=step)
    name = step.params["action"]
    try:
        action = device.spec.action(name)
    except NotFoundError as error:
        drafting.refuse(step, error.code, error.message, "params.action", **error.context)
        return DraftStep(step=step)
    if action.operation != "update" or name not in CARRYING.get(action.role, ()):
        message = f"{name} of {device.name} carries nothing: name an action that moves the thing"
        drafting.refuse(step, "plan.not_carrying", message, "params.action")
        return DraftStep(step=step)
    operation = _operation(step, drafting)
    guards = witness(step, drafting, "guard_with")
    proofs = witness(step, drafting, "confirm_with") if may_confirm(step, drafting) else []
    if step.params.get(MAY_STAY_UNCONFIRMED) is True:
        proofs = [msgspec.structs.replace(one, may_stay_unconfirmed=True) for one in proofs]
    if operation is None:
        return DraftStep(step=step)
    names = (drafting.name(operation.resource_id), drafting.name(operation.to_id))
    job = drafting.job(
        step,
        device,
        name,
        step.params.get("args", {}),
        sentence=f"Carry {names[0]} to {names[1]} with {device.name}",
        operation=operation,
        pre=guards,
        post=proofs,
        locks=(operation.resource_id,),
        estimate_s=min(action.timeout_s or CARRY_S, CARRY_S),
    )
    if job is not None:
        drafting.view = view.carried(operation.resource_id, operation.to_id)
    return draft_of(step, [job])


def _operation(step: Step, drafting: Drafting) -> TransferResource | None:
    """Return the move, from where earlier steps have put it; None: it may not be carried."""
    tree, found = drafting.view.tree, len(drafting.findings)
    moved, place = (UUID(step.params[name]) for name in ("resource", "place"))
    if moved not in tree.by_id or tree.by_id[moved].kind not in CARRIED_KINDS:
        message = "that is nothing that can be carried: a vessel, or labware, is meant"
        drafting.refuse(step, "plan.wrong_kind", message, "params.resource")
        return None
    if place not in tree.by_id:
        message = f"this lab has no resource {place}"
        drafting.refuse(step, "resource.not_found", message, "params.place")
        return None
    from_id = tree.find(moved).parent_id
    inside = {moved, *(one.id for one in tree.descendants(moved))}
    held = find_attachments(drafting.view.graph.connections, inside)
    for finding in check_loose(drafting.name(moved), str(moved), held):
        drafting.refuse(step, finding.code, finding.message, "params.resource", **finding.context)
    if from_id == place:
        message = f"{drafting.name(moved)} stands at {drafting.name(place)} already"
        drafting.refuse(step, "plan.there_already", message, "params.place")
    if from_id is None or place in inside:
        message = f"{drafting.name(moved)} cannot stand in itself"
        drafting.refuse(step, "crutd.into_itself", message, "params.place")
    if from_id != place and place not in inside:
        there = [one for one in tree.children.get(place, ()) if one.id != moved]
        sites_count = sites_of(tree.find(place).config)
        for finding in check_standing(tree.find(moved), tree.find(place), there, sites_count):
            drafting.refuse(step, finding.code, finding.message, "params.place", **finding.context)
    if from_id is None or len(drafting.findings) > found:
        return None
    return TransferResource(resource_id=moved, from_id=from_id, to_id=place)
