"""A draft may be unfinished, and is refused where no page could show it."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.workflows.workflow_draft import MOST_FINDINGS, check_draft
from labweb.domain.workflows.workflow_file import check_workflow
from tests.domain.workflows.bench import chain, flow, step
from tests.domain.workflows.documents import JSON, bent, documents, places, templates


def at(value: object) -> list[tuple[str, str]]:
    found = [(finding.code, str(finding.context["field"])) for finding in check_draft(value)]
    return [(code.removeprefix("protocol."), field) for code, field in found]


def a_flow(**of_step: object) -> dict[str, Any]:
    return flow(step("a", "wait", duration="1 s") | of_step)


@pytest.mark.parametrize("value", [*templates(), flow(), {"steps": []}])
def test_a_template_and_an_empty_page_can_be_kept(value: dict[str, Any]) -> None:
    assert check_draft(value) == []


@pytest.mark.parametrize(
    "value",
    [
        {"steps": [], "name": ""},
        flow(step("a", "wait")),
        flow(step("a", "wait", duration="5 m")),
        flow(step("a", "gone_since", what=[1, {"x": None}])),
        flow(step("a", "wait", gone=5)),
        flow(step("a", "wait"), step("b", "wait"), edges=("a>b", "b>a")),
        flow(step("a", "wait"), step("b", "wait"), edges=("a.gone>b.start",)),
    ],
    ids=["no name", "no field", "half typed", "kind", "parameter", "ring", "port"],
)
def test_what_is_only_unfinished_is_kept_and_told_by_the_check(value: dict[str, Any]) -> None:
    assert check_draft(value) == []
    assert check_workflow(value)


@pytest.mark.parametrize(
    ("value", "code", "field"),
    [
        (None, "not_object", "document"),
        ([], "not_object", "document"),
        ({}, "not_list", "steps"),
        ({"steps": None}, "not_list", "steps"),
        ({"steps": "soup"}, "not_list", "steps"),
        ({"steps": [], "edges": None}, "not_list", "edges"),
        ({"steps": [], "name": None}, "not_text", "name"),
        ({"steps": [], "name": "x" * 10_000}, "too_long", "name"),
        ({"steps": [], "schema": "labweb.workflow/9"}, "unknown_schema", "schema"),
        ({"steps": [], "colour": 1}, "unknown_field", "colour"),
        ({"steps": [], "execution": 5}, "not_object", "execution"),
        ({"steps": [None]}, "not_object", "steps[0]"),
        (flow(*[step(f"s{n}", "wait") for n in range(2000)]), "too_many_steps", "steps"),
        (a_flow(id=5), "bad_id", "steps[0].id"),
        (a_flow(id="a\n"), "bad_id", "steps[0].id"),
        (flow(step("a", "wait"), step("a", "wait")), "duplicate_id", "steps[1].id"),
        (a_flow(kind=None), "unknown_kind", "steps[0].kind"),
        (a_flow(kind="加热"), "unknown_kind", "steps[0].kind"),
        (a_flow(params=None), "not_object", "steps[0].params"),
        (a_flow(params={"duration": None}), "not_text", "steps[0].params.duration"),
        (a_flow(params={"duration": 5}), "not_text", "steps[0].params.duration"),
        (a_flow(params={"duration": "1" * 1001}), "too_long", "steps[0].params"),
        (a_flow(kind="device_action", params={"args": []}), "not_object", "steps[0].params.args"),
        (
            a_flow(kind="react", params={"consumed": {"acid": 5}}),
            "not_text",
            "steps[0].params.consumed.acid",
        ),
        (a_flow(position=None, note=None), "not_text", "steps[0].note"),
        (a_flow(note="x" * 4001), "too_long", "steps[0].note"),
        (a_flow(position=[1, 2]), "bad_position", "steps[0].position"),
        (a_flow(position={"x": float("nan"), "y": 0}), "bad_position", "steps[0].position"),
        (a_flow(position={"x": 1e300, "y": 0}), "bad_position", "steps[0].position"),
        (a_flow(position={"x": 0, "y": -1_000_001}), "bad_position", "steps[0].position"),
        (a_flow(colour="red"), "unknown_field", "steps[0].colour"),
        (a_flow() | {"edges": [None]}, "not_object", "edges[0]"),
        (a_flow() | {"edges": [{"id": "e"}]}, "missing_field", "edges[0]"),
        (chain(step("a", "wait"), step("b", "wait")) | {"steps": []}, "dangling_edge", None),
    ],
)
def test_what_no_page_could_show_is_refused_with_its_path(
    value: object, code: str, field: str | None
) -> None:
    found = at(value)
    assert found[0][0] == code
    assert field is None or found[0][1] == field
    assert all(finding.message for finding in check_draft(value))


def test_two_edges_of_one_id_and_an_edge_to_nothing_are_told_by_their_places() -> None:
    value = chain(step("a", "wait"), step("b", "wait"))
    edge = value["edges"][0]
    value["edges"] = [edge, edge, edge | {"id": "x", "target": "gone"}]
    assert at(value) == [("duplicate_id", "edges[1].id"), ("dangling_edge", "edges[2].target")]


def test_findings_are_bounded() -> None:
    assert len(check_draft({"steps": [None] * 500})) == MOST_FINDINGS


@settings(deadline=None)
@given(documents())
def test_every_document_of_the_right_shape_is_kept(value: dict[str, Any]) -> None:
    assert check_draft(value) == []


@settings(deadline=None)
@given(st.data())
def test_what_the_language_accepts_is_kept_and_nothing_makes_the_check_fail(
    data: st.DataObject,
) -> None:
    value = data.draw(st.sampled_from(templates()) | documents())
    value = bent(value, data.draw(st.sampled_from(list(places(value)))), data.draw(JSON))
    found = check_draft(value)
    assert len(found) <= MOST_FINDINGS
    if not check_workflow(value):
        assert found == []
