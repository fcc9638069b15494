"""Does what each step names exist in this lab, and can it be what the step wants?"""

from __future__ import annotations

from uuid import UUID

from labweb.domain.errors import Finding
from labweb.domain.resources.resource_kinds import KINDS
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.unit_operations.step_palette import (
    STEP_KINDS,
    ParameterSort,
    StepParameter,
)
from labweb.domain.workflows.workflow_file import Step


def check_references(step: Step, view: PlannerView) -> list[Finding]:
    """List every resource a step names that is not there or is of the wrong sort."""
    findings = []
    for parameter in STEP_KINDS[step.kind].parameters:
        value = step.params.get(parameter.name)
        if parameter.sort is not ParameterSort.RESOURCE or not isinstance(value, str):
            continue
        problem = _problem(parameter, value, view)
        if problem is not None:
            code, message = problem
            context = {"field": f"params.{parameter.name}", "reference": value}
            findings.append(Finding(code, message, step.id, context))
    return findings


def _problem(parameter: StepParameter, value: str, view: PlannerView) -> tuple[str, str] | None:
    if value.startswith("@"):
        return _wrong(
            "protocol.unresolved_key", f"{value} is a template's name: say which resource it is"
        )
    reference = UUID(value)
    resource = view.tree.by_id.get(reference)
    device = view.find_device(reference)
    if resource is None and (device is None or parameter.is_vessel):
        return _wrong("resource.not_found", f"{parameter.label}: this lab has no resource {value}")
    if resource is not None:
        is_foreign = resource.kind == "foreign" or resource.kind not in KINDS
        if is_foreign:
            return _wrong(
                "plan.foreign",
                f"{resource.name} is of a foreign class and cannot be planned with",
            )
        if parameter.is_vessel and not _is_plain_vessel(resource.kind):
            return _wrong("plan.wrong_kind", f"{resource.name} is no vessel that liquid stands in")
    return None


def _is_plain_vessel(kind: str) -> bool:
    # A syringe holds liquid only during a stroke; it is never where a person leaves it.
    return KINDS[kind].holds_liquid and kind != "syringe_pump"


def _wrong(code: str, message: str) -> tuple[str, str]:
    return code, message
