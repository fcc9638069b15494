"""The schema is made once, and who has it is told so."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from drf_spectacular.generators import SchemaGenerator

from labweb.api import schema_view as schema
from tests.builders import Bench
from tests.labweb.web import code_of, signed_in

PATH = "/api/schema/"


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Forget what was made before, and note each time that it is made."""
    found: list[bool] = []
    make: Any = SchemaGenerator.get_schema

    def noting(self: SchemaGenerator, *args: object, **kwargs: object) -> object:
        found.append(True)
        return make(self, *args, **kwargs)

    monkeypatch.setattr(SchemaGenerator, "get_schema", noting)
    monkeypatch.setattr(schema, "_made", {})
    return found


def test_the_schema_is_made_once_and_not_for_each_request(bench: Bench, made: list[bool]) -> None:
    client = signed_in(bench.people["observer"])
    first = client.get(f"{PATH}?format=json")
    assert "/api/v1/runs" in json.loads(first.content)["paths"]
    again = client.get(f"{PATH}?format=json")
    assert (again.content, again["ETag"], len(made)) == (first.content, first["ETag"], 1)
    assert client.get(PATH).content.startswith(b"openapi:")
    assert len(made) == 2, "once for each form"


def test_many_who_ask_at_once_wait_for_the_first(made: list[bool]) -> None:
    view, renderer = schema.Schema(), schema.Schema.renderer_classes[0]()
    with ThreadPoolExecutor(8) as pool:
        found = set(pool.map(lambda _: view._rendered(renderer), range(8)))
    assert (len(found), len(made)) == (1, 1)


def test_who_has_the_schema_is_told_that_it_is_the_same(bench: Bench) -> None:
    client = signed_in(bench.people["observer"])
    tag = client.get(PATH)["ETag"]
    same = client.get(PATH, headers={"If-None-Match": tag})
    assert (same.status_code, same.content) == (304, b"")
    assert client.get(PATH, headers={"If-None-Match": '"other"'}).status_code == 200


def test_an_unknown_parameter_of_the_schema_is_refused(bench: Bench) -> None:
    answer = signed_in(bench.people["observer"]).get(f"{PATH}?format=json&lang=de")
    assert (answer.status_code, code_of(answer)) == (400, "http.unknown_parameter")
