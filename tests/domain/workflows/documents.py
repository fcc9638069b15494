"""Documents as people, files and agents write them: whole, unfinished, and bent in places."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from labweb.domain.workflows.unit_operations.step_palette import (
    STEP_KINDS,
    ParameterSort,
    StepParameter,
)

TEMPLATES = Path(__file__).parents[3] / "fixtures" / "labs" / "starter" / "workflows"

TEXTS = st.one_of(
    st.text(st.characters(codec="utf-8", exclude_characters="\x00"), max_size=12),
    st.sampled_from(
        [
            "",
            " ",
            "5 mL",
            "all",
            "@water",
            "__proto__",
            "constructor",
            "工作流",
            "\u202eabc",
            "x" * 900,
        ]
    ),
)
NUMBERS = st.one_of(
    st.integers(-(10**20), 10**20),
    st.floats(allow_nan=False, allow_infinity=False),
    st.sampled_from([0, -0.0, 1e308, 2**53 + 1]),
)
PLAIN = st.one_of(st.none(), st.booleans(), NUMBERS, TEXTS)
JSON = st.recursive(
    PLAIN,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(TEXTS.filter(len), inner, max_size=3)
    ),
    max_leaves=6,
)
IDS = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_.:-]{0,9}", fullmatch=True) | st.sampled_from(
    ["constructor", "toString", "0", "e1", "a:b.c-d_e", "x" * 80]
)
KINDS = st.sampled_from([*STEP_KINDS, "gone_since", "constructor"])
PLACES = st.fixed_dictionaries(
    {
        "x": st.one_of(st.integers(-(10**6), 10**6), st.floats(-1e6, 1e6)),
        "y": st.one_of(st.integers(-(10**6), 10**6), st.floats(-1e6, 1e6)),
    }
)


def _value(parameter: StepParameter) -> st.SearchStrategy[Any]:
    match parameter.sort:
        case ParameterSort.AMOUNTS:
            return st.dictionaries(TEXTS, TEXTS, max_size=3)
        case ParameterSort.ARGUMENTS:
            return st.dictionaries(TEXTS, JSON, max_size=3)
        case _:
            return TEXTS


@st.composite
def steps(draw: st.DrawFn, step_id: str) -> dict[str, Any]:
    kind = draw(KINDS)
    operation = STEP_KINDS.get(kind)
    parameters = () if operation is None else operation.parameters
    given = {p.name: draw(_value(p)) for p in parameters if draw(st.booleans())}
    if operation is None or draw(st.integers(0, 5)) == 0:
        given |= draw(st.dictionaries(TEXTS, JSON, max_size=2))
    step: dict[str, Any] = {"id": step_id, "kind": kind}
    is_told: bool = draw(st.booleans())
    if given or is_told:
        step["params"] = given
    if draw(st.integers(0, 3)):
        step["position"] = draw(PLACES)
    if draw(st.booleans()):
        step["note"] = draw(TEXTS)
    return step


@st.composite
def documents(draw: st.DrawFn) -> dict[str, Any]:
    """Draw a document of the right shape, whatever it means."""
    ids = draw(st.lists(IDS, max_size=6, unique=True))
    ports = st.sampled_from(["done", "start", "vessel", "source", "target", "value", "gone"])
    edges = [
        {
            "id": edge_id,
            "source": draw(st.sampled_from(ids)),
            "source_port": draw(ports),
            "target": draw(st.sampled_from(ids)),
            "target_port": draw(ports),
        }
        for edge_id in draw(
            st.lists(TEXTS.filter(lambda t: 0 < len(t) <= 80), max_size=6, unique=True)
        )
        if ids
    ]
    document: dict[str, Any] = {"steps": [draw(steps(step_id)) for step_id in ids]}
    is_told: bool = draw(st.booleans())
    if edges or is_told:
        document["edges"] = edges
    if draw(st.booleans()):
        document["schema"] = "labweb.workflow/1"
    if draw(st.integers(0, 3)):
        document["name"] = draw(TEXTS.filter(lambda t: len(t) <= 200))
    if draw(st.integers(0, 3)) == 0:
        document["execution"] = {"on_disconnect": "stop_safe", "max_offline_s": 60}
    return document


def templates() -> list[dict[str, Any]]:
    """Return the documents that the starter lab brings."""
    return [json.loads(path.read_text("utf-8")) for path in sorted(TEMPLATES.glob("*.json"))]


def places(value: object, at: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Yield the path of each place of a document."""
    yield at
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from places(inner, (*at, key))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from places(inner, (*at, index))


def bent(value: Any, at: tuple[str | int, ...], into: object) -> Any:  # noqa: ANN401 - plain JSON
    """Return a document with one place exchanged."""
    if not at:
        return into
    copy = json.loads(json.dumps(value))
    inner = copy
    for key in at[:-1]:
        inner = inner[key]
    inner[at[-1]] = into
    return copy
