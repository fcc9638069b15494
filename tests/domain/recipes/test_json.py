"""The JSON form: read strictly, with the path of everything that is wrong."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.errors import ProtocolError
from labweb.domain.recipes.xdl.file_format.read_xdl import check_document
from labweb.domain.recipes.xdl.file_format.xdl_json import parse_json
from labweb.domain.recipes.xdl.file_format.xml_tree import MAX_BYTES, parse_markup, render_markup

GOOD: dict[str, Any] = {
    "xdl": "2.0.0",
    "hardware": [{"name": "r", "properties": {"id": "r", "component_type": "reactor"}}],
    "reagents": [{"name": "w", "properties": {"name": "w", "density": 1.0, "solid": False}}],
    "steps": [
        {"comment": "first"},
        {
            "name": "Add",
            "properties": {"vessel": "r", "reagent": "w", "volume": 5},
            "section": "Prep",
        },
    ],
}


def read(value: object) -> list[tuple[str, str]]:
    _, findings = check_document(parse_json(json.dumps(value).encode()))
    return [(finding.code, finding.subject) for finding in findings]


def test_a_number_is_in_the_standard_unit() -> None:
    recipe, findings = check_document(parse_json(json.dumps(GOOD).encode()))
    assert not findings
    (step,) = recipe.synthesis.steps
    assert step.section == "Prep"
    assert recipe.version == "2.0.0"


def test_a_finding_names_the_path() -> None:
    steps = [{"name": "Add", "properties": {"vessel": "r", "reagent": "w", "volume": "5 g"}}]
    assert read(GOOD | {"steps": steps}) == [("unit.unknown", "steps[0].properties.volume")]
    assert read(GOOD | {"steps": [{"name": "Mix"}]}) == [("xdl.unknown_step", "steps[0]")]


@pytest.mark.parametrize(
    ("raw", "code"),
    [
        (b"", "xdl.json"),
        (b"{", "xdl.json"),
        (b'{"a": 1, "a": 2}', "xdl.json"),
        (b"1" * 10_000, "xdl.json"),
        (b'{"steps": ' + b"1" * 10_000 + b"}", "xdl.json"),
        (b"[]", "xdl.json_layout"),
        (b"\xff", "xdl.encoding"),
        (b"[" * 100_000, "xdl.too_deep"),
        (b'{"a":' * 200 + b"1" + b"}" * 200, "xdl.too_deep"),
        (b" " * (MAX_BYTES + 1), "xdl.too_large"),
        (json.dumps({"steps": ["a" * 20_000]}).encode(), "xdl.text"),
        (json.dumps({"steps": [1] * 60_000}).encode(), "xdl.too_many"),
        (json.dumps({"colour": 1}).encode(), "xdl.json_layout"),
        (json.dumps({"steps": {}}).encode(), "xdl.json_layout"),
        (json.dumps({"steps": [1]}).encode(), "xdl.json_layout"),
        (json.dumps({"steps": [{"name": "Add", "colour": 1}]}).encode(), "xdl.json_layout"),
        (
            json.dumps({"steps": [{"name": "Add", "properties": {"a": []}}]}).encode(),
            "xdl.json_layout",
        ),
        (
            json.dumps({"steps": [{"name": "Add", "properties": {"a": "\0"}}]}).encode(),
            "xdl.json_layout",
        ),
        (b'{"steps": [{"name": "Add", "properties": {"a": "\\ud800"}}]}', "xdl.json_layout"),
        (json.dumps({"steps": [{"comment": "a -- b"}]}).encode(), "xdl.json_layout"),
        (json.dumps({"comments": ["-->"]}).encode(), "xdl.json_layout"),
    ],
    ids=lambda value: value[:30].decode("latin-1") if isinstance(value, bytes) else value,
)
def test_a_bad_json_file_is_refused(raw: bytes, code: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        parse_json(raw)
    assert caught.value.code == code


LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
KEYS = st.sampled_from(
    [*GOOD, "name", "properties", "children", "section", "comment", "blueprints"]
)
VALUES = st.recursive(
    LEAVES,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=4),
    max_leaves=12,
)


@settings(max_examples=150)
@given(st.dictionaries(KEYS, VALUES, max_size=5))
def test_any_json_is_read_or_refused(value: dict[str, Any]) -> None:
    try:
        document = parse_json(json.dumps(value).encode())
    except ProtocolError:
        return
    recipe, findings = check_document(document)
    if not findings:
        assert parse_markup(render_markup(recipe.document).encode()).root == document.root
