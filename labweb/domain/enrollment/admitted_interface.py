"""What of a driver's interface a person has admitted, and how far."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from labweb.domain.enrollment.driver_spec import ActionSpec, DriverSpec, ParameterSpec
from labweb.domain.errors import Finding

Admission = Mapping[str, Mapping[str, float]]
"""Action → parameter → highest value. What is not named is withheld. Empty: reading only."""


SHOWS_ITSELF = "show_itself"
"""Action by which a person sees that this is the device on the bench: `text` for `shown_s`."""


def shows_itself(spec: DriverSpec) -> bool:
    """Tell whether a driver can show a text on its device, and nothing else happens by it."""
    return any(
        one.name == SHOWS_ITSELF
        and one.operation == "read"
        and not one.hazards
        and {parameter.name for parameter in one.parameters} == {"text", "shown_s"}
        for one in spec.actions
    )


def admitted_spec(spec: DriverSpec, admission: Admission | None) -> DriverSpec:
    """Return the interface as far as it was admitted; None: all of it, as the driver declares."""
    if admission is None:
        return spec
    actions = tuple(
        _limited(action, admission[action.name])
        for action in spec.actions
        if action.name in admission
    )
    return msgspec.structs.replace(spec, actions=actions)


def _limited(action: ActionSpec, limits: Mapping[str, float]) -> ActionSpec:
    parameters = tuple(_lower(one, limits.get(one.name)) for one in action.parameters)
    return msgspec.structs.replace(action, parameters=parameters)


def _lower(parameter: ParameterSpec, limit: float | None) -> ParameterSpec:
    if limit is None:
        return parameter
    known = parameter.maximum
    return msgspec.structs.replace(parameter, maximum=limit if known is None else min(known, limit))


def check_admission(spec: DriverSpec, admission: Admission) -> list[Finding]:
    """List every way in which an admission does not fit the driver; empty means go."""
    actions = {action.name: action for action in spec.actions}
    findings = []
    for name, limits in admission.items():
        action = actions.get(name)
        if action is None:
            text = f"the driver has no action {name!r:.80}"
            findings.append(Finding("device.unknown_action", text, subject=name))
            continue
        parameters = {parameter.name: parameter for parameter in action.parameters}
        findings += [
            problem
            for key, limit in limits.items()
            if (problem := _check_limit(name, key, limit, parameters.get(key))) is not None
        ]
    return findings


def _check_limit(
    action: str, name: str, limit: float, parameter: ParameterSpec | None
) -> Finding | None:
    subject = f"{action}.{name}"
    if parameter is None or parameter.type not in {"number", "integer"}:
        text = f"{action} takes no number {name!r:.80} that could be limited"
        return Finding("device.unknown_limit", text, subject=subject)
    low, high = parameter.minimum, parameter.maximum
    if not abs(limit) < float("inf") or (low is not None and limit < low):
        text = f"{action}: a limit of {limit:g} leaves nothing of {name}"
        return Finding("device.bad_limit", text, subject=subject)
    if high is not None and limit > high:
        text = f"{action}: the driver allows {name} up to {high:g}; a limit only lowers that"
        return Finding("device.bad_limit", text, subject=subject)
    return None


def refusal(admission: Admission | None, action: str, args: Mapping[str, Any]) -> tuple[str, str]:
    """Say why an action is not admitted: a code and a text; both "" mean go.

    The host asks this too, whatever the server has signed.
    """
    if admission is None:
        return "", ""
    limits = admission.get(action)
    if limits is None:
        return "edge.not_admitted", f"{action} was withheld when the device was admitted"
    for name, limit in limits.items():
        value = args.get(name)
        if isinstance(value, int | float) and value > limit:
            text = f"{action}: {name} is {value:g}, and was admitted up to {limit:g}"
            return "edge.over_limit", text
    return "", ""
