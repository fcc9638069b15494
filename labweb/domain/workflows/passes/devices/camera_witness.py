"""Cameras as witnesses: a step that looks, and what guards and confirms a carry."""

from __future__ import annotations

from collections.abc import Mapping
from uuid import UUID

from labweb.domain.crutd.pre_and_postconditions import Condition, sees_tag, sees_vessel
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.workflows.passes.devices.heat_stir_wait_measure import READ_S, draft_of
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftStep
from labweb.domain.workflows.passes.role_requirements import plays
from labweb.domain.workflows.workflow_file import Step

MIN_CONFIDENCE = 0.9
"""A camera that is less sure has seen nothing."""

LOOK_TIMEOUT_S = 10.0
"""How long a camera may take to see what has to be there."""


def plan_look(step: Step, drafting: Drafting) -> DraftStep:
    """Read a camera, and go on only when it surely sees what is asked for."""
    camera = _camera(step, drafting, "camera")
    if camera is None:
        return DraftStep(step=step)
    job = drafting.job(
        step,
        camera,
        "look",
        {},
        sentence=f"Look with {camera.name}",
        post=(_seen(camera, step.params, is_there=False),),
        estimate_s=READ_S,
    )
    return draft_of(step, [job])


def witness(step: Step, drafting: Drafting, name: str) -> list[Condition]:
    """Return what the camera that a step names must see; nothing where it names none."""
    if name not in step.params:
        return []
    camera = _camera(step, drafting, name)
    if camera is None:
        return []
    return [_seen(camera, step.params, is_there=True, timeout_s=LOOK_TIMEOUT_S)]


def _camera(step: Step, drafting: Drafting, name: str) -> AdmittedDevice | None:
    device = drafting.view.find_device(UUID(step.params[name]))
    if device is not None and plays(device, "camera"):
        return device
    message = "no device of this lab is a camera there"
    drafting.refuse(step, "plan.no_device", message, f"params.{name}", role="camera")
    return None


def _seen(
    camera: AdmittedDevice, params: Mapping[str, str], *, is_there: bool, timeout_s: float = 0.0
) -> Condition:
    """Return what a camera must see: the tag, or else that a vessel stands there, or none."""
    sure = MIN_CONFIDENCE
    if "tag" in params:
        return sees_tag(camera.id, params["tag"], min_confidence=sure, timeout_s=timeout_s)
    return sees_vessel(camera.id, is_present=is_there, min_confidence=sure, timeout_s=timeout_s)
