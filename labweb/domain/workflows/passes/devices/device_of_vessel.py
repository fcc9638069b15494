"""Which device serves a vessel, and whether it reaches what a step asks for."""

from __future__ import annotations

from uuid import UUID

from labweb.domain.calibration.correction import CalibrationQuantity
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.units import parse
from labweb.domain.workflows.passes.devices.calibration_correction import (
    ACCURACIES,
    check_accuracy,
    in_force,
)
from labweb.domain.workflows.passes.drafted_jobs import Drafting
from labweb.domain.workflows.passes.role_requirements import plays
from labweb.domain.workflows.workflow_file import Step


def carriers(drafting: Drafting, vessel: UUID, role: str) -> list[AdmittedDevice]:
    """Return the devices of a role that the vessel stands on, or else is coupled to."""
    view = drafting.view
    found: dict[UUID, AdmittedDevice] = {}
    for resource in view.carriers(vessel):
        device = view.device_by_node.get(resource.id)
        if device is not None and plays(device, role):
            found.setdefault(device.id, device)
    return list(found.values())


def find_carrier(step: Step, drafting: Drafting, vessel: UUID, role: str) -> AdmittedDevice | None:
    """Return the one device of a role that a vessel stands on; note when it is not one."""
    found = carriers(drafting, vessel, role)
    if len(found) == 1:
        return found[0]
    name = drafting.name(vessel)
    if found:
        names = ", ".join(device.name for device in found)
        message = f"{name} has more than one {role}: {names}"
        drafting.refuse(step, "plan.ambiguous_device", message, "params.vessel", role=role)
    else:
        message = f"{name} stands on no {role} that a device of this lab drives"
        drafting.refuse(step, "plan.no_device", message, "params.vessel", role=role)
    return None


def is_accurate(
    step: Step,
    drafting: Drafting,
    device: AdmittedDevice,
    quantity: CalibrationQuantity,
    value: float | None = None,
) -> bool:
    """Tell whether a device is known to be as accurate as a step needs.

    Without a value: wherever it may read.
    """
    if "accuracy" not in step.params:
        return True
    wanted, known = parse(step.params["accuracy"], ACCURACIES[quantity]), in_force(device, quantity)
    levels = () if known is None else tuple(level.value for level in known.levels)
    found = check_accuracy(device, quantity, levels if value is None else (value,), wanted)
    for finding in found:
        drafting.refuse(step, finding.code, finding.message, "params.accuracy")
    return not found


def condenses(drafting: Drafting, vessel: UUID, receiver: UUID) -> bool:
    """Tell whether a one-way tube for gas leads from a vessel to one that condenses its vapour."""
    return any(
        way.medium is Medium.GAS
        and way.source.resource_id == vessel
        and way.target.resource_id == receiver
        for way in drafting.view.graph.by_resource.get(vessel, ())
    )
