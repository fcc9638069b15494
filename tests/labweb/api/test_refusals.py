"""The schema says how each operation refuses, and files say of which type they are."""

from __future__ import annotations

from typing import Any

import pytest
from django.test import Client
from drf_spectacular.generators import SchemaGenerator

from tests.builders import Bench
from tests.labweb.web import call, signed_in

NO_ID = "/api/v1/hosts/no-id/fence"


@pytest.fixture(scope="module")
def schema() -> dict[str, Any]:
    make: Any = SchemaGenerator
    made: dict[str, Any] = make(api_version="v1").get_schema(public=True)
    return made


def _answers(schema: dict[str, Any], method: str, path: str) -> dict[str, Any]:
    found: dict[str, Any] = schema["paths"][f"/api/v1/{path}"][method]["responses"]
    return found


def test_each_refusal_is_named_by_its_status_and_has_the_one_shape(schema: dict[str, Any]) -> None:
    for path, item in schema["paths"].items():
        for operation in item.values():
            refused = {s: one for s, one in operation["responses"].items() if int(s) >= 400}
            assert {"400", "403", "404", "429", "503"} <= set(refused), path
            for status, answer in refused.items():
                assert answer == {"$ref": f"#/components/responses/Refused{status}"}
    for answer in schema["components"]["responses"].values():
        (content,) = answer["content"].values()
        assert content["schema"] == {"$ref": "#/components/schemas/Refusal"}


def test_what_acts_may_conflict_and_what_reads_may_not(schema: dict[str, Any]) -> None:
    assert {"409", "412", "422", "423"} <= set(_answers(schema, "post", "runs"))
    assert not {"409", "412", "423"} & set(_answers(schema, "get", "home"))
    assert "422" in _answers(schema, "get", "runs")
    assert "422" not in _answers(schema, "get", "home")
    assert "401" not in _answers(schema, "post", "deliveries")  # no token is taken there


def test_a_file_is_described_with_every_type_that_it_has(schema: dict[str, Any]) -> None:
    kinds = {
        "files/{file_id}/content": {"*/*"},
        "devices/{device_id}/telemetry/export": {"text/csv", "application/vnd.apache.parquet"},
        "lab/export": {"application/json"},
    }
    for path, types in kinds.items():
        assert set(_answers(schema, "get", path)["200"]["content"]) == types
    lab = _answers(schema, "get", "lab/export")["200"]["content"]["application/json"]["schema"]
    assert lab["type"] == "object"


def test_an_answer_that_may_be_a_document_is_one_of_both_or_fits_both(
    schema: dict[str, Any],
) -> None:
    content = _answers(schema, "get", "lots/{lot_id}/provenance")["200"]["content"]
    assert set(content["application/json"]["schema"]) == {"anyOf"}  # each graph is an object, too


@pytest.mark.parametrize("is_member", [False, True])
def test_an_id_that_is_none_is_refused_in_the_one_shape(bench: Bench, is_member: bool) -> None:
    user = bench.people["chemist"] if is_member else None
    strict = signed_in(user)
    strict.handler.enforce_csrf_checks = True  # as a program without a session meets it
    answer = call(strict, "POST", NO_ID, {"reason": "it burnt"})
    assert answer.status_code == 404
    assert answer["Content-Type"] == "application/json"
    assert answer.json()["code"] == "http.not_found"  # type: ignore[attr-defined] # Django's client


def test_the_token_of_a_page_is_asked_for_where_there_is_something(bench: Bench) -> None:
    strict: Client = signed_in(bench.people["chemist"])
    strict.handler.enforce_csrf_checks = True
    answer = call(strict, "POST", "/api/v1/lab/stop", {})
    assert answer.status_code == 403
    assert answer["Content-Type"] == "application/json"
