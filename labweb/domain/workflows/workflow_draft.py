"""What a draft may be: unfinished in every way that the editor shows, and nothing else.

A draft is saved while somebody draws it, so a missing field, a quantity that cannot be read yet
or a ring is a finding of its check and no refusal. What no page could open is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.workflows.nesting_depth import LONGEST_TEXT, arguments_problem, check_depth
from labweb.domain.workflows.offline_execution import read_execution
from labweb.domain.workflows.unit_operations.step_palette import STEP_KINDS, ParameterSort
from labweb.domain.workflows.workflow_edges import Edge, read_edge
from labweb.domain.workflows.workflow_file import (
    LONGEST_NAME,
    LONGEST_NOTE,
    MOST_EDGES,
    MOST_STEPS,
    SCHEMA,
    STEP_ID,
    read_position,
)

MOST_FINDINGS = 50
"""Findings that are told at once."""

_KIND = re.compile(r"^[A-Za-z][A-Za-z0-9_]{0,59}$")
_HEAD = frozenset({"schema", "name", "steps", "edges", "execution"})
_STEP = frozenset({"id", "kind", "params", "position", "note"})
_OBJECTS = frozenset({ParameterSort.AMOUNTS, ParameterSort.ARGUMENTS})


def check_draft(value: object) -> list[Finding]:
    """List each place of a draft that no page could show; an empty list means it can be kept.

    Returns:
        At most `MOST_FINDINGS` findings. `context["field"]` is the path of the place from the
        root of the document, such as `steps[3].params.volume`, and the message begins with it.
    """
    if not isinstance(value, Mapping):
        return [_finding("protocol.not_object", "document", "a workflow is a JSON object")]
    deep = check_depth(value)
    if deep is not None:
        return [deep]
    found: list[Finding] = []
    for finding in _check(value):
        found.append(finding)
        if len(found) == MOST_FINDINGS:
            break
    return found


def _check(value: Mapping[Any, Any]) -> Iterator[Finding]:
    yield from _check_fields(value, _HEAD, "")
    if value.get("schema", SCHEMA) != SCHEMA:
        yield _finding("protocol.unknown_schema", "schema", f"the schema is {SCHEMA!r}")
    if "name" in value:
        yield from _check_text(value["name"], "name", LONGEST_NAME)
    yield from read_execution(value.get("execution"))[1]
    steps, edges = value.get("steps"), value.get("edges", [])
    for at, items, most in (("steps", steps, MOST_STEPS), ("edges", edges, MOST_EDGES)):
        if not isinstance(items, list):
            yield _finding("protocol.not_list", at, "this is a list")
            return
        if len(items) > most:
            yield _finding("protocol.too_many_steps", at, f"a workflow has at most {most} of them")
            return
    ids: dict[str, str] = {}
    for place, raw in enumerate(steps or ()):
        yield from _check_step(raw, f"steps[{place}]", ids)
    yield from _check_edges(edges, ids)


def _check_step(raw: object, at: str, ids: dict[str, str]) -> Iterator[Finding]:
    if not isinstance(raw, Mapping):
        yield _finding("protocol.not_object", at, "a step is an object")
        return
    yield from _check_fields(raw, _STEP, f"{at}.")
    step_id, kind, params = raw.get("id"), raw.get("kind"), raw.get("params", {})
    if not isinstance(step_id, str) or not STEP_ID.fullmatch(step_id):
        yield _finding("protocol.bad_id", f"{at}.id", "an id is of letters, digits and _ . : -")
    elif step_id in ids:
        message = f"{ids[step_id]} has the id {step_id!r}, too"
        yield _finding("protocol.duplicate_id", f"{at}.id", message)
    else:
        ids[step_id] = at
    if not isinstance(kind, str) or not _KIND.fullmatch(kind):
        message = "a kind of step is a name of letters, digits and _"
        yield _finding("protocol.unknown_kind", f"{at}.kind", message)
    if isinstance(params, Mapping):
        yield from _check_params(kind, params, f"{at}.params")
    else:
        yield _finding("protocol.not_object", f"{at}.params", "parameters are an object")
    yield from _check_text(raw.get("note", ""), f"{at}.note", LONGEST_NOTE)
    if read_position(raw.get("position")) is None:
        message = "a position is x and y, each at most 1 000 000 pixels from the middle"
        yield _finding("protocol.bad_position", f"{at}.position", message)


def _check_params(kind: object, params: Mapping[Any, Any], at: str) -> Iterator[Finding]:
    operation = STEP_KINDS.get(kind) if isinstance(kind, str) else None
    problem = arguments_problem(params)
    if problem is not None:
        yield _finding(problem[0], at, problem[1])
        return
    for name, value in params.items():
        parameter = None if operation is None else operation.parameter(name)
        if parameter is None:
            continue
        here = f"{at}.{name}"
        if parameter.sort not in _OBJECTS:
            yield from _check_text(value, here, LONGEST_TEXT)
        elif not isinstance(value, Mapping):
            yield _finding("protocol.not_object", here, "this is an object")
        elif parameter.sort is ParameterSort.AMOUNTS:
            for key, amount in value.items():
                yield from _check_text(amount, f"{here}.{key}", LONGEST_TEXT)


def _check_edges(edges: Sequence[Any], ids: Mapping[str, str]) -> Iterator[Finding]:
    seen: dict[str, str] = {}
    for place, raw in enumerate(edges):
        at = f"edges[{place}]"
        unread: list[Finding] = []
        edge = read_edge(raw, place, unread)
        yield from unread
        if edge is None:
            continue
        if edge.id in seen:
            message = f"{seen[edge.id]} has the id {edge.id!r}, too"
            yield _finding("protocol.duplicate_id", f"{at}.id", message)
        seen.setdefault(edge.id, at)
        yield from _check_ends(edge, at, ids)


def _check_ends(edge: Edge, at: str, ids: Mapping[str, str]) -> Iterator[Finding]:
    for name, end in (("source", edge.source), ("target", edge.target)):
        if end not in ids:
            yield _finding("protocol.dangling_edge", f"{at}.{name}", f"there is no step {end!r}")


def _check_fields(value: Mapping[Any, Any], known: frozenset[str], at: str) -> Iterator[Finding]:
    for key in value:
        if key not in known:
            message = f"there is no such field; there are {', '.join(sorted(known))}"
            yield _finding("protocol.unknown_field", f"{at}{key}", message)


def _check_text(value: object, at: str, longest: int) -> Iterator[Finding]:
    if not isinstance(value, str):
        yield _finding("protocol.not_text", at, "this is a text")
    elif len(value) > longest:
        yield _finding("protocol.too_long", at, f"this text has at most {longest} characters")


def _finding(code: str, at: str, message: str) -> Finding:
    where = at if len(at) <= LONGEST_NAME else f"{at[:LONGEST_NAME]}…"
    return Finding(code, f"{where}: {message}", "", {"field": where})
