"""The unit operations a person can place, and the sentences they read as.

This one table feeds the browser's palette and forms, the parser and the compiler.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from labweb.domain.resources.resource_kinds import KINDS, Nature
from labweb.domain.workflows.unit_operations.chemistry_steps import CHEMISTRY_STEPS, REACT
from labweb.domain.workflows.unit_operations.liquid_steps import (
    EMPTY_SYRINGE,
    MAY_STAY_UNCONFIRMED,
    TRANSFER,
    UNCONFIRMED,
    UNCONFIRMED_CLAUSE,
)
from labweb.domain.workflows.unit_operations.person_steps import PERSON_STEPS
from labweb.domain.workflows.unit_operations.solid_steps import SOLID_STEPS
from labweb.domain.workflows.unit_operations.unit_operation import (
    LONGEST_QUANTITY,
    LONGEST_REFERENCE,
    ParameterSort,
    PortKind,
    StepMatter,
    StepParameter,
    StepPort,
    UnitOperation,
    advanced,
    device,
    optional,
    quantity,
    text,
    vessel,
)

__all__ = [
    "LONGEST_QUANTITY",
    "LONGEST_REFERENCE",
    "MAY_STAY_UNCONFIRMED",
    "STEP_KINDS",
    "ParameterSort",
    "PortKind",
    "StepParameter",
    "StepPort",
    "UnitOperation",
    "palette",
    "sentence",
    "sentence_text",
]

_FIXED = {"lab", "site", "room", "bench", "workstation", "deck", "slot", "archive", "foreign"}

CARRIED_KINDS = tuple(
    name
    for name, kind in KINDS.items()
    if kind.nature is Nature.RESOURCE
    and name not in _FIXED | {"well", "tip_spot", "storage", "sample_loop", "separator", "filter"}
)
"""What a device may carry: vessels, and labware with all that stands in it."""

_PLACES = tuple(name for name, kind in KINDS.items() if kind.is_place and name != "archive")

_FIELD = re.compile(r"\{(\w+)\}")
_MISSING = "…"


_CALLED = (
    StepParameter(
        name="action",
        sort=ParameterSort.NAME,
        label="Action",
        help="Name of the action in the driver.",
    ),
    StepParameter(
        name="args",
        sort=ParameterSort.ARGUMENTS,
        label="Arguments",
        help="As the driver's schema asks for; numbers in the unit of their name.",
        is_required=False,
    ),
)
"""Which action of a device is called, and with what."""

_BY_DRIVER = StepMatter(unproved="what the action of a driver does to matter is not followed")

STEP_KINDS: Mapping[str, UnitOperation] = {
    operation.kind: operation
    for operation in (
        TRANSFER,
        EMPTY_SYRINGE,
        UnitOperation(
            kind="heat_chill",
            label="Heat or chill",
            help="Bring a vessel to a temperature; with a hold, switch off after it.",
            parameters=(
                vessel("vessel", "Vessel", "Vessel on a heater or chiller."),
                quantity("temperature", "temperature", "Temperature", "Such as 60 °C."),
                optional(
                    quantity("stir_speed", "speed", "Stir at", "Stir meanwhile, such as 400 rpm.")
                ),
                optional(
                    quantity(
                        "hold_for",
                        "time",
                        "Hold for",
                        "Keep the temperature so long, then stop heating and stirring. "
                        "Left empty, both stay on.",
                    )
                ),
                advanced(
                    quantity(
                        "tolerance",
                        "temperature_difference",
                        "Reached within",
                        "How near it has to come before the step goes on, such as 0.5 K; 1 K when "
                        "left empty.",
                    )
                ),
                advanced(
                    quantity(
                        "accuracy",
                        "temperature_difference",
                        "Accuracy",
                        "Largest expanded uncertainty (k = 2), such as 0.5 K; a heater whose "
                        "calibration does not reach it is refused.",
                    )
                ),
            ),
            clauses=(
                "Bring {vessel} to {temperature}",
                " to within {accuracy}",
                ", reached within {tolerance}",
                ", stir at {stir_speed}",
                ", hold for {hold_for}",
            ),
        ),
        UnitOperation(
            kind="stir",
            label="Stir",
            help="Stir a vessel for a time, then stop.",
            parameters=(
                vessel("vessel", "Vessel", "Vessel on a stirrer."),
                quantity("stir_speed", "speed", "Speed", "Such as 400 rpm."),
                quantity("duration", "time", "Duration", "How long, such as 10 min."),
            ),
            clauses=("Stir {vessel} at {stir_speed} for {duration}",),
        ),
        UnitOperation(
            kind="stop_heat_stir",
            label="Stop heating and stirring",
            help="Switch off whatever heats or stirs a vessel.",
            parameters=(vessel("vessel", "Vessel", "Vessel on a heater or stirrer."),),
            clauses=("Stop heating and stirring {vessel}",),
        ),
        UnitOperation(
            kind="wait",
            label="Wait",
            help="Do nothing for a time, counted by a timer of the lab.",
            parameters=(quantity("duration", "time", "Duration", "How long, such as 10 min."),),
            clauses=("Wait {duration}",),
        ),
        REACT,
        *CHEMISTRY_STEPS,
        *SOLID_STEPS,
        *PERSON_STEPS,
        UnitOperation(
            kind="weigh",
            label="Weigh",
            help="Read a balance once it is stable.",
            parameters=(device("balance", ["balance"], "Balance", "Balance to read."),),
            clauses=("Weigh on {balance}",),
            measures="Mass",
        ),
        UnitOperation(
            kind="measure_ph",
            label="Measure pH",
            help="Read a pH transmitter.",
            parameters=(
                device("transmitter", ["transmitter"], "Transmitter", "pH transmitter to read."),
                advanced(
                    quantity(
                        "accuracy",
                        "ph_difference",
                        "Accuracy",
                        "Largest expanded uncertainty (k = 2), such as 0.1 pH; a probe whose "
                        "calibration does not reach it is refused.",
                    )
                ),
            ),
            clauses=("Measure pH with {transmitter}", " to within {accuracy}"),
            measures="pH",
        ),
        UnitOperation(
            kind="look",
            label="Look",
            help="Look at a place with a camera. What is not seen surely ends the run here.",
            parameters=(
                device("camera", [], "Camera", "Camera that looks at the place."),
                optional(
                    text("tag", "Tag", "Tag that must be read there; empty: no vessel may stand.")
                ),
            ),
            clauses=("Look with {camera}", " for {tag}"),
        ),
        UnitOperation(
            kind="carry",
            label="Carry",
            help="Have a device take a vessel or labware to another place, with all in it.",
            parameters=(
                device("resource", list(CARRIED_KINDS), "What", "Nothing may be plugged to it."),
                device("place", list(_PLACES), "To", "Place where it stands afterwards."),
                device("device", [], "With", "Arm, vehicle or store that carries it."),
                *_CALLED,
                optional(text("tag", "Tag", "Tag on the thing, which the cameras must read.")),
                optional(device("guard_with", [], "Guard with", "Camera that must see it before.")),
                optional(
                    device(
                        "confirm_with", [], "Confirm with", "Camera that must see it afterwards."
                    )
                ),
                UNCONFIRMED,
            ),
            clauses=(
                "Carry {resource} to {place} with {device}",
                ", tag {tag}",
                ", seen before by {guard_with}",
                ", seen afterwards by {confirm_with}",
                UNCONFIRMED_CLAUSE,
            ),
        ),
        UnitOperation(
            kind="device_action",
            matter=_BY_DRIVER,
            label="Device action",
            help="Call one action of one device, as its driver declares it.",
            parameters=(
                device("device", [], "Device", "Device that acts."),
                *_CALLED,
                optional(
                    device(
                        "sample",
                        list(CARRIED_KINDS),
                        "Sample",
                        "What is measured, on the device; readings and files are linked to it. "
                        "Left empty, the one vessel that stands there.",
                    )
                ),
            ),
            clauses=("Run {action} on {device}", " with {sample}"),
        ),
        UnitOperation(
            kind="role_action",
            matter=_BY_DRIVER,
            label="Action by role",
            help="Call one action of whichever device of a role is free under a place, when its "
            "turn comes.",
            parameters=(
                StepParameter(
                    name="role",
                    sort=ParameterSort.NAME,
                    label="Role",
                    help="What the device has to be, such as balance.",
                ),
                device("under", list(_PLACES), "Under", "Bench, room or lab in which it stands."),
                *_CALLED,
            ),
            clauses=("Run {action} on a {role} under {under}",),
        ),
    )
}
"""Unit operation by kind."""


def palette() -> list[dict[str, Any]]:
    """Return every unit operation as plain data, in the order of the palette."""
    return [operation.to_json() for operation in STEP_KINDS.values()]


def sentence(
    kind: str, params: Mapping[str, Any], names: Mapping[str, str]
) -> list[dict[str, Any]]:
    """Say in plain language what a step does.

    Args:
        kind: Kind of step, in `STEP_KINDS`.
        params: Its parameters as typed.
        names: Name by resource reference; an unknown one is shown as an ellipsis.

    Returns:
        Parts in order. `strong` marks what a person filled in; `sort` says what it is:
        `text`, `quantity`, `resource` or `name`.

    Example:
        >>> parts = sentence("wait", {"duration": "10 min"}, {})
        >>> [(part["text"], part["strong"]) for part in parts]
        [('Wait ', False), ('10 min', True)]
    """
    operation = STEP_KINDS[kind]
    parts: list[dict[str, Any]] = []
    for clause in operation.clauses:
        fields = [operation.parameter(name) for name in _FIELD.findall(clause)]
        if any(p is not None and not p.is_required and not _is_given(p, params) for p in fields):
            continue
        for position, piece in enumerate(_FIELD.split(clause)):
            if position % 2 == 0:
                parts += [_part(piece, "text")] if piece else []
            elif not _is_switch(operation, piece):
                parts.append(_filled(operation, piece, params, names))
    return parts


def _is_given(parameter: StepParameter, params: Mapping[str, Any]) -> bool:
    if parameter.sort is ParameterSort.SWITCH:
        return params.get(parameter.name) is True
    return parameter.name in params


def _is_switch(operation: UnitOperation, name: str) -> bool:
    parameter = operation.parameter(name)
    return parameter is not None and parameter.sort is ParameterSort.SWITCH


def sentence_text(kind: str, params: Mapping[str, Any], names: Mapping[str, str]) -> str:
    """Return the sentence of a step without marks.

    Example:
        >>> sentence_text("device_action", {"action": "select_port", "device": "@p"}, {"@p": "P"})
        'Run select port on P'
    """
    return "".join(part["text"] for part in sentence(kind, params, names))


def called(step: Mapping[str, Any], names: Mapping[str, str]) -> str:
    """Return what a person calls a step of a document, perhaps an unfinished one: its sentence.

    Args:
        step: As the document has it.
        names: Name by resource reference; what is named by its key needs none.

    Example:
        >>> called({"kind": "wait", "params": {"duration": "10 min"}}, {})
        "'Wait 10 min'"
    """
    kind, given = step.get("kind"), step.get("params")
    if not isinstance(kind, str) or kind not in STEP_KINDS:
        return f"a step {kind!r:.40}"
    params = given if isinstance(given, Mapping) else {}
    keys = {one: one[1:] for one in params.values() if isinstance(one, str) and one[:1] == "@"}
    return repr(sentence_text(kind, params, {**keys, **names}))


def _filled(
    operation: UnitOperation, name: str, params: Mapping[str, Any], names: Mapping[str, str]
) -> dict[str, Any]:
    parameter = operation.parameter(name)
    sort = parameter.sort if parameter is not None else ParameterSort.NAME
    value = params.get(name)
    if not isinstance(value, str):
        return _part(_MISSING, sort.value)
    if sort is ParameterSort.RESOURCE:
        return _part(names.get(value, _MISSING), sort.value)
    told = value.replace("_", " ") if sort is ParameterSort.NAME else value
    return _part(" ".join(told.split()), sort.value)


def _part(text: str, sort: str) -> dict[str, Any]:
    return {"text": text, "strong": sort != "text", "sort": sort}
