"""What an action measures, and what it draws from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from uuid import UUID

from labweb.domain.crutd.operations import Dispose
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.enrollment.driver_spec import ActionSpec
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob
from labweb.domain.workflows.workflow_file import Step

INJECTION = "injection_ul"
"""Argument of an action that draws so much from its sample, for good."""

AT_CELL: Mapping[str, frozenset[str]] = {
    "potentiostat": frozenset(
        {"measure_open_circuit", "hold_potential", "sweep_linear", "sweep_cyclic"}
    ),
    "battery_tester": frozenset({"start_test", "await_end"}),
}
"""By role: actions that measure what their electrodes are connected to."""

NL_PER_UL = 1000
GRID_NL = 1e-6


def injection_job(
    step: Step, drafting: Drafting, device: AdmittedDevice, estimate_s: float
) -> DraftJob | None:
    """Make the job of an action that draws from a sample which stands in the device.

    None: it cannot be planned, and the findings say why.
    """
    name, args = step.params["action"], step.params.get("args", {})
    if "sample" not in step.params:
        message = f"{name} of {device.name} draws from a sample: say which"
        drafting.refuse(step, "plan.no_sample", message, "params.sample")
        return None
    amount_nl = on_grid_nl(step, drafting, args.get(INJECTION), INJECTION)
    if amount_nl is None:
        return None
    sample = sample_in(step, drafting, device, device.spec.action(name))
    if sample is None or sample.resource_id is None:
        return None
    sample_id = sample.resource_id
    return drafting.job(
        step,
        device,
        name,
        args,
        sentence=f"{device.name}: {name.replace('_', ' ')} {drafting.name(sample_id)}",
        operation=Dispose(resource_id=sample_id, amount_nl=amount_nl),
        locks=drafting.view.vessels_on(device),
        estimate_s=estimate_s,
    )


def on_grid_nl(step: Step, drafting: Drafting, told_ul: object, argument: str) -> int | None:
    """Return a volume in whole nanolitres; None, noted: it lies between two of them."""
    amount_nl = told_ul * NL_PER_UL if isinstance(told_ul, int | float) else 0.0
    if abs(amount_nl - round(amount_nl)) > GRID_NL:
        message = f"{told_ul:g} µL is finer than a nanolitre, the least that is recorded"
        drafting.refuse(step, "plan.off_grid", message, f"params.args.{argument}")
        return None
    return round(amount_nl)


@dataclass(frozen=True, slots=True)
class MeasuredSample:
    """What an action measures; None: nothing, or nobody knows which of several it is."""

    resource_id: UUID | None


def sample_in(
    step: Step, drafting: Drafting, device: AdmittedDevice, action: ActionSpec
) -> MeasuredSample | None:
    """Return what an action measures: what the step names, or the one vessel there.

    None, noted: the step names what this action does not measure, or it measures at one of
    several cells and the step does not say at which.
    """
    there = drafting.view.vessels_on(device)
    is_at_cell = action.name in AT_CELL.get(action.role, ())
    is_drawing = INJECTION in {one.name for one in action.parameters}
    is_measuring = action.operation == "read" or is_at_cell or is_drawing
    if is_at_cell:
        there |= drafting.view.cells_of(device)
    if "sample" not in step.params:
        if is_at_cell and len(there) > 1:
            names = ", ".join(sorted(map(drafting.name, there)))
            message = f"{action.name} of {device.name} measures at {names}: say at which"
            drafting.refuse(step, "plan.no_sample", message, "params.sample")
            return None
        is_known = is_measuring and len(there) == 1
        return MeasuredSample(next(iter(there)) if is_known else None)
    sample_id = UUID(step.params["sample"])
    if not is_measuring:
        message = f"{action.name} of {device.name} measures no sample"
        drafting.refuse(step, "plan.no_sample", message, "params.sample")
        return None
    if sample_id not in there:
        reached = ", and its electrodes are not connected to it" if is_at_cell else ""
        message = f"{drafting.name(sample_id)} does not stand on {device.name}{reached}"
        drafting.refuse(step, "plan.sample_elsewhere", message, "params.sample")
        return None
    return MeasuredSample(sample_id)
