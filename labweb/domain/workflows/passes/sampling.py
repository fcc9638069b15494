"""What an action measures, and what it draws from it."""

from __future__ import annotations

from uuid import UUID

from labweb.domain.crutd.operations import Dispose
from labweb.domain.enrollment.device import Device
from labweb.domain.workflows.passes.draft import Drafting, DraftJob
from labweb.domain.workflows.protocol import Step

INJECTION = "injection_ul"
"""Argument of an action that draws so much from its sample, for good."""

NL_PER_UL = 1000
GRID_NL = 1e-6


def injection_job(
    step: Step, drafting: Drafting, device: Device, estimate_s: float
) -> DraftJob | None:
    """Make the job of an action that draws from a sample which stands in the device.

    None: it cannot be planned, and the findings say why.
    """
    name, args = step.params["action"], step.params.get("args", {})
    if "sample" not in step.params:
        message = f"{name} of {device.name} draws from a sample: say which"
        drafting.refuse(step, "plan.no_sample", message, "params.sample")
        return None
    told = args.get(INJECTION)
    amount_nl = told * NL_PER_UL if isinstance(told, int | float) else 0.0
    if abs(amount_nl - round(amount_nl)) > GRID_NL:
        message = f"{told:g} µL is finer than a nanolitre, the least that is recorded"
        drafting.refuse(step, "plan.off_grid", message, f"params.args.{INJECTION}")
        return None
    sample_id = sample_in(step, drafting, device, is_reading=True)
    if sample_id is None:
        return None
    return drafting.job(
        step,
        device,
        name,
        args,
        sentence=f"{device.name}: {name.replace('_', ' ')} {drafting.name(sample_id)}",
        operation=Dispose(resource_id=sample_id, amount_nl=round(amount_nl)),
        locks=drafting.view.vessels_on(device),
        estimate_s=estimate_s,
    )


def sample_in(step: Step, drafting: Drafting, device: Device, *, is_reading: bool) -> UUID | None:
    """Return what a reading action measures: what the step names, or the one vessel there.

    None: it changes something and measures nothing, or nobody has said which of several it is.
    """
    there = drafting.view.vessels_on(device)
    if "sample" not in step.params:
        return next(iter(there)) if is_reading and len(there) == 1 else None
    sample_id = UUID(step.params["sample"])
    if not is_reading:
        message = f"{step.params['action']} of {device.name} measures no sample"
        drafting.refuse(step, "plan.no_sample", message, "params.sample")
        return None
    if sample_id not in there:
        message = f"{drafting.name(sample_id)} does not stand on {device.name}"
        drafting.refuse(step, "plan.sample_elsewhere", message, "params.sample")
        return None
    return sample_id
