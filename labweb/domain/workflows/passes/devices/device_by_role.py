"""An action that names no device: any that plays a role under a place, the first that is free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from uuid import UUID

from labweb.domain.crutd.operations import Read, Update
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.errors import Finding
from labweb.domain.workflows.passes.devices.calibration_correction import correct_step
from labweb.domain.workflows.passes.devices.heat_stir_wait_measure import (
    draft_of,
    plan_device_action,
)
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob, DraftStep
from labweb.domain.workflows.plan import Execution
from labweb.domain.workflows.workflow_file import Step


def plan_role_action(step: Step, drafting: Drafting) -> DraftStep:
    """Plan the action on every device that may do it, each as if the step named it.

    The job stands as on the first of them, in the order of their keys. Which one does it is
    decided when its turn comes, among these and no others: they are what a person approves.
    """
    role, under = step.params["role"], UUID(step.params["under"])
    place = drafting.name(under)
    found = [one for one in drafting.view.devices_by_key if role in one.spec.roles]
    there = [one for one in found if _stands_under(one, under, drafting)]
    if not there:
        known = sorted({one for device in drafting.view.devices for one in device.spec.roles})
        message = f"no device under {place} is a {role}; the roles of this lab are "
        text = message + (", ".join(known) or "none")
        drafting.refuse(step, "plan.no_device", text, "params.role", role=role)
        return DraftStep(step=step)
    tried = [(device, *_on(device, step, drafting)) for device in there]
    jobs = [job for _, job, _ in tried if job is not None]
    left = [f"{device.name}: {why}" for device, job, why in tried if job is None]
    if not jobs:
        message = f"no {role} under {place} can do this: {'; '.join(left)}"
        drafting.refuse(step, "plan.no_device", message, "params.action", role=role)
        return DraftStep(step=step)
    action = step.params["action"].replace("_", " ")
    names = ", ".join(job.device.name for job in jobs)
    notes = [f"{action}: the first of {names} that is free when its turn comes"]
    notes += [f"{action}: not {one}" for one in left]
    sentence = f"{role.replace('_', ' ').capitalize()} under {place}: {action}"
    job = replace(jobs[0], sentence=sentence, choices=tuple(jobs))
    return replace(draft_of(step, [job]), notes=tuple(notes))


def check_whole(drafts: Sequence[DraftStep], execution: Execution | None) -> list[Finding]:
    """List steps that leave their device open in a run that goes to its hosts whole.

    A host that works alone has nobody who chooses.
    """
    if execution is None:
        return []
    text = "a run that goes to its hosts whole names its devices: say which one does this"
    return [
        Finding("plan.role_in_batch", text, draft.step.id, {"field": "params.role"})
        for draft in drafts
        if any(job.choices for job in draft.jobs)
    ]


def _stands_under(device: AdmittedDevice, under: UUID, drafting: Drafting) -> bool:
    tree = drafting.view.tree
    return any(
        node == under or any(one.id == under for one in tree.ancestors(node))
        for node in device.nodes.values()
        if node in tree.by_id
    )


def _on(device: AdmittedDevice, step: Step, drafting: Drafting) -> tuple[DraftJob | None, str]:
    """Return the job on one device, or why it cannot be that one; nothing is noted."""
    named = {name: step.params[name] for name in ("action", "args") if name in step.params}
    trial = replace(drafting, findings=[])
    own = replace(step, kind="device_action", params={**named, "device": str(device.id)})
    draft = plan_device_action(own, trial)
    draft = draft if trial.findings else correct_step(draft, trial)
    if trial.findings or not draft.jobs:
        return None, "; ".join(one.message for one in trial.findings)
    (job,) = draft.jobs
    is_plain = isinstance(job.operation, Read | Update)
    if not is_plain or device.spec.action(job.action).operation == "transfer":
        return None, "the action moves what is in vessels: name the device"
    return job, ""
