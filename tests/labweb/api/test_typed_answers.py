"""Every operation says what it answers with, and every type that it names is there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pytest
from drf_spectacular.generators import SchemaGenerator

_METHODS = ("get", "post", "put", "patch", "delete")


@pytest.fixture(scope="module")
def schema() -> dict[str, Any]:
    make: Any = SchemaGenerator
    generator = make(api_version="v1")
    made: dict[str, Any] = generator.get_schema(public=True)
    return made


def _named(part: object) -> Iterator[str]:
    """Yield every reference of a schema."""
    if isinstance(part, Mapping):
        if isinstance(part.get("$ref"), str):
            yield part["$ref"]
        for inner in part.values():
            yield from _named(inner)
    elif isinstance(part, list):
        for inner in part:
            yield from _named(inner)


def _is_file(body: Mapping[str, Any]) -> bool:
    return body.get("format") == "binary" or body.get("title") == "File"


def _untyped(schema: Mapping[str, Any]) -> list[str]:
    found = []
    for path, item in schema["paths"].items():
        for method in _METHODS:
            answers = item.get(method, {}).get("responses", {})
            bodies = [
                answer.get("content", {}).get("application/json", {}).get("schema", {"$ref": ""})
                for status, answer in answers.items()
                if str(status).startswith("2")
            ]
            bodies = [body.get("anyOf", [body])[0] for body in bodies]
            if not all("$ref" in body or _is_file(body) for body in bodies):
                found.append(f"{method} {path}")
    return found


def test_every_type_that_the_schema_names_is_in_it(schema: dict[str, Any]) -> None:
    known = {
        f"#/components/{kind}/{name}"
        for kind in ("schemas", "responses")
        for name in schema["components"][kind]
    }
    assert len(known) > 50
    assert set(_named(schema)) <= known


def test_every_operation_says_what_they_answer_with(schema: dict[str, Any]) -> None:
    assert _untyped(schema) == []


def test_an_untyped_answer_is_found() -> None:
    body = {"application/json": {"schema": {"type": "object"}}}
    item = {"get": {"responses": {"200": {"content": body}}}}
    assert _untyped({"paths": {"/a": item}}) == ["get /a"]
