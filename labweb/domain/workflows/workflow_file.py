"""The workflow as people, files and agents write it; hostile until parsed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from uuid import UUID

from labweb.domain.errors import Finding, ProtocolError, UnitError
from labweb.domain.resources.resource_tree import Tree
from labweb.domain.units import parse_exact, parse_mass_ug, parse_volume_nl
from labweb.domain.workflows.nesting_depth import arguments_problem, check_depth
from labweb.domain.workflows.offline_execution import read_execution, render_execution
from labweb.domain.workflows.plan import Execution
from labweb.domain.workflows.unit_operations.step_palette import (
    STEP_KINDS,
    ParameterSort,
    StepParameter,
    UnitOperation,
)
from labweb.domain.workflows.workflow_edges import Edge, check_edges

SCHEMA = "labweb.workflow/1"
MOST_STEPS = 500
MOST_EDGES = 2000
LONGEST_NAME = 200
LONGEST_NOTE = 4000
MOST_PIXELS = 1_000_000

STEP_ID = re.compile(r"^[A-Za-z0-9][A-Za-z0-9_.:-]{0,79}$")
KEY = re.compile(r"[^\s@](?:[^@\n\r\t]{0,77}[^\s@])?")
"""Key of a resource behind `@`: graphs of others have keys with blanks in them."""

_ABSOLUTE_ZERO_C = -273.15
_MAY_BE_NEGATIVE = frozenset({"temperature"})
_ON_GRID = {"volume": parse_volume_nl, "mass": parse_mass_ug}


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A unit operation with its parameters, as typed."""

    id: str
    kind: str
    params: Mapping[str, Any] = field(default_factory=dict)
    position: tuple[float, float] = (0.0, 0.0)
    """x and y on the canvas, pixels."""

    note: str = ""

    def to_json(self) -> dict[str, Any]:
        """Render as the file has it."""
        plain: dict[str, Any] = {
            "id": self.id,
            "kind": self.kind,
            "params": dict(self.params),
            "position": {"x": self.position[0], "y": self.position[1]},
        }
        return plain | ({"note": self.note} if self.note else {})


@dataclass(frozen=True, slots=True, kw_only=True)
class Workflow:
    """Steps and the edges that order them: a directed graph without a cycle."""

    name: str
    steps: tuple[Step, ...]
    edges: tuple[Edge, ...]
    execution: Execution | None = None

    def step(self, step_id: str) -> Step:
        """Return the step of that id; `KeyError` when there is none."""
        for step in self.steps:
            if step.id == step_id:
                return step
        raise KeyError(step_id)


def parse_workflow(value: object) -> Workflow:
    """Read a workflow from plain data.

    Raises:
        ProtocolError: It breaks the language; `findings` list every reason, each with the
            step's id as subject and the field in `context`. Nothing is guessed or dropped.
    """
    workflow, findings = _read(value)
    if workflow is None or findings:
        count = len(findings)
        raise ProtocolError(
            f"the workflow has {count} finding{'' if count == 1 else 's'}: {findings[0].message}",
            findings=findings,
        )
    return workflow


def check_workflow(value: object) -> list[Finding]:
    """List every way in which plain data is no workflow; an empty list means it is."""
    return _read(value)[1]


def render_workflow(workflow: Workflow) -> dict[str, Any]:
    """Render as plain data; `parse_workflow` reads it back."""
    return {
        "schema": SCHEMA,
        "name": workflow.name,
        "steps": [step.to_json() for step in workflow.steps],
        "edges": [edge.to_json() for edge in workflow.edges],
        **render_execution(workflow.execution),
    }


def resolve_keys(workflow: Workflow, tree: Tree) -> Workflow:
    """Turn `@key` references of a template into ids of this lab's resources.

    Raises:
        ProtocolError: The lab has no resource of that key; `findings` list each.
    """
    findings: list[Finding] = []
    steps = tuple(replace(s, params=_resolved(s, tree, findings)) for s in workflow.steps)
    if findings:
        raise ProtocolError(findings[0].message, code=findings[0].code, findings=findings)
    return replace(workflow, steps=steps)


def bind_materials(workflow: Workflow) -> Workflow:
    """Fill each vessel that a step leaves open from the material edge that ends there.

    Edges are followed from the first step to the last, so that a vessel goes through a
    whole chain of steps.
    """
    steps = {step.id: step for step in workflow.steps}
    for _ in range(len(workflow.steps)):
        before = dict(steps)
        for edge in workflow.edges:
            source, target = steps[edge.source], steps[edge.target]
            operation = STEP_KINDS[target.kind]
            parameter = operation.parameter(edge.target_port)
            vessel = source.params.get(edge.source_port)
            if parameter is None or vessel is None or edge.target_port in target.params:
                continue
            params = {**target.params, edge.target_port: vessel}
            steps[target.id] = replace(target, params=params)
        if before == steps:
            break
    return replace(workflow, steps=tuple(steps[step.id] for step in workflow.steps))


def _resolved(step: Step, tree: Tree, findings: list[Finding]) -> dict[str, Any]:
    operation = STEP_KINDS[step.kind]
    params = dict(step.params)
    for name, value in step.params.items():
        parameter = operation.parameter(name)
        if parameter is None or parameter.sort is not ParameterSort.RESOURCE:
            continue
        if not value.startswith("@"):
            continue
        resource = tree.by_key.get(value[1:])
        if resource is None:
            message = f"this lab has no resource with the key {value[1:]!r}"
            findings.append(_finding("protocol.unknown_key", message, step.id, f"params.{name}"))
        else:
            params[name] = str(resource.id)
    return params


def _finding(code: str, message: str, subject: str, at: str) -> Finding:
    return Finding(code, message, subject, {"field": at})


def _wrong(code: str, message: str) -> tuple[str, str]:
    return code, message


def _read(value: object) -> tuple[Workflow | None, list[Finding]]:
    if not isinstance(value, Mapping):
        return None, [_finding("protocol.not_object", "a workflow is a JSON object", "", "")]
    problem = check_depth(value)
    if problem is not None:
        return None, [problem]
    findings = _check_head(value)
    raw_steps, raw_edges = value.get("steps"), value.get("edges", [])
    if not isinstance(raw_steps, list) or not isinstance(raw_edges, list):
        findings.append(_finding("protocol.not_list", "steps and edges are lists", "", "steps"))
        return None, findings
    if len(raw_steps) > MOST_STEPS or len(raw_edges) > MOST_EDGES:
        message = f"a workflow has at most {MOST_STEPS} steps and {MOST_EDGES} edges"
        findings.append(_finding("protocol.too_many_steps", message, "", "steps"))
        return None, findings
    edges, edge_findings = check_edges(raw_edges, raw_steps)
    fed = {(edge.target, edge.target_port) for edge in edges}
    steps = [_read_step(raw, place, fed, findings) for place, raw in enumerate(raw_steps)]
    execution, execution_findings = read_execution(value.get("execution"))
    ids = [step.id for step in steps if step is not None]
    findings += edge_findings + execution_findings + _check_duplicates(ids)
    if findings or None in steps:
        return None, findings
    read = tuple(step for step in steps if step is not None)
    name = value["name"].strip()
    return Workflow(name=name, steps=read, edges=tuple(edges), execution=execution), findings


def _check_head(value: Mapping[Any, Any]) -> list[Finding]:
    findings = _check_fields(value, {"schema", "name", "steps", "edges", "execution"}, "")
    if value.get("schema", SCHEMA) != SCHEMA:
        message = f"schema is {SCHEMA!r}; got {value['schema']!r:.60}"
        findings.append(_finding("protocol.unknown_schema", message, "", "schema"))
    name = value.get("name")
    if not isinstance(name, str) or not name.strip():
        findings.append(_finding("protocol.missing_field", "a workflow has a name", "", "name"))
    elif len(name) > LONGEST_NAME:
        message = f"the name is longer than {LONGEST_NAME} characters"
        findings.append(_finding("protocol.too_long", message, "", "name"))
    return findings


def _check_fields(value: Mapping[Any, Any], known: set[str], subject: str) -> list[Finding]:
    return [
        _finding(
            "protocol.unknown_field", f"{key!r:.60} means nothing here", subject, str(key)[:60]
        )
        for key in value
        if key not in known
    ]


def _check_duplicates(ids: list[str]) -> list[Finding]:
    twice = sorted({step_id for step_id in ids if ids.count(step_id) > 1})
    return [
        _finding("protocol.duplicate_id", f"two steps have the id {i!r}", i, "id") for i in twice
    ]


def _read_step(
    raw: object, place: int, fed: set[tuple[str, str]], findings: list[Finding]
) -> Step | None:
    if not isinstance(raw, Mapping):
        findings.append(
            _finding("protocol.not_object", f"step {place} is no object", "", f"steps[{place}]")
        )
        return None
    step_id = raw.get("id")
    if not isinstance(step_id, str) or not STEP_ID.match(step_id):
        message = f"step {place} needs an id of letters, digits and _ . : -; got {step_id!r:.60}"
        findings.append(_finding("protocol.bad_id", message, "", f"steps[{place}].id"))
        return None
    before = len(findings)
    findings += _check_fields(raw, {"id", "kind", "params", "position", "note"}, step_id)
    kind = raw.get("kind")
    operation = STEP_KINDS.get(kind) if isinstance(kind, str) else None
    if operation is None:
        message = f"no unit operation {kind!r:.60}; there are {', '.join(STEP_KINDS)}"
        findings.append(_finding("protocol.unknown_kind", message, step_id, "kind"))
        return None
    params = raw.get("params", {})
    if not isinstance(params, Mapping):
        findings.append(_finding("protocol.not_object", "params is no object", step_id, "params"))
        return None
    filled = {port for step, port in fed if step == step_id}
    findings += _check_params(operation, params, step_id, filled)
    note, position = raw.get("note", ""), read_position(raw.get("position"))
    if not isinstance(note, str) or len(note) > LONGEST_NOTE:
        message = f"a note is text of at most {LONGEST_NOTE} characters"
        findings.append(_finding("protocol.too_long", message, step_id, "note"))
    if position is None:
        findings.append(
            _finding("protocol.bad_position", "position is x and y", step_id, "position")
        )
    if position is None or len(findings) > before:
        return Step(id=step_id, kind=operation.kind)
    return Step(id=step_id, kind=operation.kind, params=dict(params), position=position, note=note)


def read_position(value: object) -> tuple[float, float] | None:
    """Return x and y on the canvas, in pixels; None: it is no place on it."""
    if value is None:
        return 0.0, 0.0
    if not isinstance(value, Mapping) or set(value) != {"x", "y"}:
        return None
    x, y = value["x"], value["y"]
    if not _is_on_canvas(x) or not _is_on_canvas(y):
        return None
    return float(x), float(y)


def _is_on_canvas(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= MOST_PIXELS


def _check_params(
    operation: UnitOperation, params: Mapping[Any, Any], step_id: str, filled: set[str]
) -> list[Finding]:
    names = [p.name for p in operation.parameters]
    findings = [
        _finding(
            "protocol.unknown_param",
            f"{operation.label} has no {name!r:.60}; it has {', '.join(names)}",
            step_id,
            f"params.{name!s:.60}",
        )
        for name in params
        if name not in names
    ]
    for parameter in operation.parameters:
        at = f"params.{parameter.name}"
        if parameter.name in params:
            problem = _problem(parameter, params[parameter.name])
            if problem is not None:
                findings.append(_finding(*problem, step_id, at))
        elif parameter.is_required and parameter.name not in filled:
            message = f"{operation.label} needs {parameter.label.lower()!r}: {parameter.help}"
            findings.append(_finding("protocol.missing_param", message, step_id, at))
    return findings


def _problem(parameter: StepParameter, value: object) -> tuple[str, str] | None:
    match parameter.sort:
        case ParameterSort.QUANTITY:
            return None if parameter.means_all(value) else _quantity_problem(parameter, value)
        case ParameterSort.RESOURCE:
            if isinstance(value, str) and (_is_uuid(value) or _is_key(value)):
                return None
            text = f"{parameter.label} is the id of a resource; got {value!r:.60}"
            return _wrong("protocol.bad_reference", text)
        case ParameterSort.NAME | ParameterSort.TEXT:
            if parameter.takes_text(value):
                return None
            is_name = parameter.sort is ParameterSort.NAME
            what = "a name" if is_name else f"one line of 1 to {parameter.longest} characters"
            return _wrong("protocol.bad_name", f"{parameter.label} is {what}; got {value!r:.60}")
        case ParameterSort.SWITCH:
            text = f"{parameter.label} is true or false; got {value!r:.60}"
            return None if isinstance(value, bool) else _wrong("protocol.bad_switch", text)
        case ParameterSort.ARGUMENTS | ParameterSort.AMOUNTS:
            return arguments_problem(value)


def _quantity_problem(parameter: StepParameter, value: object) -> tuple[str, str] | None:
    try:
        if parameter.quantity in _ON_GRID:
            _ON_GRID[parameter.quantity](value)
            return None
        number = parse_exact(value, parameter.quantity)
    except UnitError as error:
        return error.code, error.message
    if parameter.quantity == "temperature" and number < _ABSOLUTE_ZERO_C:
        return _wrong("unit.out_of_range", f"{value!r} is below absolute zero")
    if parameter.quantity not in _MAY_BE_NEGATIVE and number <= 0:
        return _wrong("unit.not_positive", f"{value!r} is not positive")
    return None


def _is_key(value: str) -> bool:
    return value.startswith("@") and KEY.fullmatch(value, 1) is not None


def _is_uuid(text: str) -> bool:
    try:
        return str(UUID(text)) == text.lower()
    except ValueError:
        return False
