"""Liquid that a pipetting robot moves between the wells on its deck."""

from __future__ import annotations

from uuid import UUID

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.workflows.passes.devices.sampling import on_grid_nl
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob
from labweb.domain.workflows.workflow_file import Step

ROLE, BETWEEN_WELLS = "liquid_handler", "transfer_liquid"
STROKE_S = 30.0
"""Estimate of one transfer, with the ways of the gantry."""


def moves_between_wells(device: AdmittedDevice, name: str) -> bool:
    """Tell whether an action moves liquid from a well of the device's deck to another."""
    return name == BETWEEN_WELLS and device.spec.action(name).role == ROLE


def deck_job(step: Step, drafting: Drafting, device: AdmittedDevice) -> DraftJob | None:
    """Make the job of a transfer from well to well, booked from the one to the other.

    None: it cannot be planned, and the findings say why.
    """
    args = step.params.get("args", {})
    amount_nl = on_grid_nl(step, drafting, args.get("volume_ul"), "volume_ul")
    source_id = _well(step, drafting, device, "source")
    target_id = _well(step, drafting, device, "target")
    if amount_nl is None or source_id is None or target_id is None:
        return None
    return drafting.job(
        step,
        device,
        BETWEEN_WELLS,
        args,
        sentence=f"{device.name}: {drafting.name(source_id)} to {drafting.name(target_id)}",
        operation=TransferLiquid(source_id=source_id, target_id=target_id, amount_nl=amount_nl),
        locks=(source_id, target_id),
        estimate_s=STROKE_S,
    )


def _well(step: Step, drafting: Drafting, device: AdmittedDevice, end: str) -> UUID | None:
    """Return the one well of the deck that slot and well name; None, noted: there is none."""
    args = step.params.get("args", {})
    wanted = args.get(f"{end}_slot"), args.get(f"{end}_well")
    view = drafting.view
    found = [one for one in view.vessels_on(device) if _address(drafting, one) == wanted]
    if len(found) == 1:
        return found[0]
    count = "no well" if not found else f"{len(found)} wells"
    message = f"{device.name} has {count} {wanted[1]} in a slot {wanted[0]} of its deck"
    drafting.refuse(step, "plan.no_well", message, f"params.args.{end}_well")
    return None


def _address(drafting: Drafting, vessel_id: UUID) -> tuple[str, str] | None:
    """Return slot and well by the last part of their keys, as labware is imported."""
    tree = drafting.view.tree
    slot = next((one for one in tree.ancestors(vessel_id) if one.kind == "slot"), None)
    if slot is None:
        return None
    return slot.key.rpartition("/")[2], tree.find(vessel_id).key.rpartition("/")[2]
