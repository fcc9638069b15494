"""Which plans need a person before they may start."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from labweb.domain.workflows.plan import CapableDevice, Plan, PlannedJob


class TemperatureAtLeast(
    msgspec.Struct, frozen=True, tag="temperature_at_least", tag_field="kind", kw_only=True
):
    """Asks when an action sets a temperature at or above the limit."""

    temperature_c: float


Rule = TemperatureAtLeast


def parse_rule(value: object) -> Rule:
    """Read a policy's rule.

    Raises:
        msgspec.ValidationError: No such kind of rule, or a field is wrong.
    """
    return msgspec.convert(value, Rule)


def asks(rule: Rule, plan: Plan) -> bool:
    """Tell whether the rule wants a person to look at the plan: as asked, or as sent."""
    return any(
        isinstance(value, int | float) and value >= rule.temperature_c
        for job in plan.jobs
        for way in job.ways()
        for value in _temperatures(way)
    )


def _temperatures(job: PlannedJob | CapableDevice) -> Iterator[object]:
    yield job.args.get("temperature_c")
    yield from (one.asked for one in job.corrections if one.argument == "temperature_c")


def check_decision(*, asked_by: str, actor: str, allow_self: bool, state: str) -> tuple[str, str]:
    """Return (code, message) of what forbids a decision, both empty when nothing does."""
    if state != "open":
        return "approval.answered", f"this request is {state} already"
    if asked_by == actor and not allow_self:
        return "approval.own_request", "a second person has to answer: you asked yourself"
    return "", ""
