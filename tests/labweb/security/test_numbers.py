"""No number of a body makes the server fail, at any depth of any body that there is."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from django.db.transaction import atomic, set_rollback
from msgspec import inspect
from pytest_django import Settings

from labweb.domain.dimensions import DIMENSIONS
from labweb.domain.workflows.unit_operations.step_palette import STEP_KINDS
from tests.builders import Bench
from tests.labweb.security.rest_table import API, Form
from tests.labweb.security.test_lists import VIEWS
from tests.labweb.security.test_matrix import prepare
from tests.labweb.security.things import one_of_each
from tests.labweb.web import call, signed_in

HOLE = "<a number>"
SOME_ID = "0198a000-0000-7000-8000-000000000002"
PLAIN: dict[type[inspect.Type], Any] = {
    inspect.BoolType: True,
    inspect.DictType: {},
    inspect.NoneType: None,
}
NONE_AT_ALL = ("9" * 316, "9" * 5000, "1e400", "-1e400", "NaN", "Infinity", "-Infinity")
TOO_LARGE = ("9" * 290, str(2**63), str(-(2**63) - 1), "1e308", "-1e308")


def body_of(method: str, route: str) -> type[msgspec.Struct] | None:
    """Return the struct that reads the body of an endpoint; None: it declares none."""
    declared: dict[str, type[msgspec.Struct]] = getattr(VIEWS[route.split("?")[0]], "bodies", {})
    return declared.get(method.lower())


BODIES = sorted((method, route) for method, route in API if body_of(method, route) is not None)


def sample(kind: inspect.Type) -> Any:  # noqa: ANN401 - a value of any sort
    """Return a value that fits a type."""
    match kind:
        case inspect.StructType():
            plain = {one.encode_name: sample(one.type) for one in kind.fields if one.required}
            return plain if kind.tag_field is None else {kind.tag_field: kind.tag, **plain}
        case inspect.ListType() | inspect.VarTupleType():
            return [sample(kind.item_type)]
        case inspect.UnionType():
            return sample(kind.types[0])
        case inspect.IntType() | inspect.FloatType():
            return 1
        case inspect.UUIDType():
            return SOME_ID
        case inspect.LiteralType():
            return kind.values[0]
        case inspect.EnumType():
            return next(iter(kind.cls)).value
        case _:
            return PLAIN.get(type(kind), "x")


def holes(kind: inspect.Type, told: dict[str, Any] | None = None) -> Iterator[tuple[bool, Any]]:
    """Yield values with one number left open, and whether that is declared as a number.

    Args:
        kind: What is to be filled.
        told: What stands around it where it is a struct; else the least that fits.
    """
    match kind:
        case inspect.IntType() | inspect.FloatType():
            yield True, HOLE
        case inspect.AnyType():
            yield from ((False, HOLE), (False, {"x": [HOLE]}))
        case inspect.StructType():
            around = {**sample(kind), **(told or {})}
            for one in kind.fields:
                for is_number, value in holes(one.type):
                    yield is_number, {**around, one.encode_name: value}
        case inspect.UnionType():
            for choice in kind.types:
                yield from holes(choice)
        case _:
            yield from _inside(kind)


def _inside(kind: inspect.Type) -> Iterator[tuple[bool, Any]]:
    if isinstance(kind, inspect.ListType | inspect.VarTupleType):
        yield from ((is_number, [value]) for is_number, value in holes(kind.item_type))
    elif isinstance(kind, inspect.DictType):
        yield from ((is_number, {"x": value}) for is_number, value in holes(kind.value_type))


@pytest.fixture
def ids(bench: Bench, settings: Settings, tmp_path: Path) -> dict[str, str]:
    settings.DATA_DIR = tmp_path
    return one_of_each(bench)


def test_every_body_is_declared() -> None:
    told = {
        (method, route)
        for (method, route), (_, body) in API.items()
        if isinstance(body, dict) and body and not isinstance(body, Form)
    }
    assert told <= set(BODIES)


def test_the_bodies_have_numbers_at_all_depths() -> None:
    found = [
        value
        for method, route in BODIES
        for _, value in holes(inspect.type_info(body_of(method, route)))
    ]
    assert len(found) > 80
    assert any(json.dumps(value).count("[") > 1 for value in found)


@pytest.mark.parametrize(("method", "route"), BODIES)
def test_a_number_that_is_none_or_too_large_is_refused(
    bench: Bench, ids: dict[str, str], method: str, route: str
) -> None:
    client = signed_in(bench.people["admin"])
    path = "/api/v1/" + re.sub(r"<(\w+)>", lambda found: ids[found[1]], route)
    filled = re.sub(
        r'"<(\w+)>"', lambda found: f'"{ids[found[1]]}"', json.dumps(API[method, route][1])
    )
    wrong = []
    for is_number, value in holes(inspect.type_info(body_of(method, route)), json.loads(filled)):
        for token in (*NONE_AT_ALL[:: 1 if is_number else 3], *TOO_LARGE, "-0"):
            raw = json.dumps(value).replace(f'"{HOLE}"', token)
            with atomic():
                prepare(bench, route, ids)
                answer = client.generic(method, path, raw, content_type="application/json")
                set_rollback(True)
            is_refused = 400 <= answer.status_code < 500
            must_be = token in NONE_AT_ALL or (is_number and token in TOO_LARGE)
            if answer.status_code >= 500 or (must_be and not is_refused):
                wrong.append((token[:12], answer.status_code, raw[:300]))
    assert not wrong


def test_no_amount_typed_into_a_step_makes_the_server_fail(bench: Bench) -> None:
    client, wrong = signed_in(bench.people["chemist"]), []
    places = {"resource": str(bench.node("water").id), "switch": True}
    for operation in STEP_KINDS.values():
        plain = {one.name: places.get(one.sort, "1") for one in operation.parameters}
        for one in operation.parameters:
            unit = next(iter(DIMENSIONS[one.quantity].units)) if one.quantity else ""
            for token in (*NONE_AT_ALL[::2], *TOO_LARGE, "-0"):
                params = {**plain, one.name: f"{token} {unit}"}
                step = {"id": "a", "kind": operation.kind, "params": params}
                step["position"] = {"x": 0, "y": 0}
                document = {
                    "schema": "labweb.workflow/1",
                    "name": "N",
                    "edges": [],
                    "steps": [step],
                }
                body = {"document": document}
                answer = call(client, "POST", "/api/v1/workflows/check", body)
                if answer.status_code >= 500:
                    wrong.append((operation.kind, one.name, token[:12], answer.status_code))
    assert not wrong
