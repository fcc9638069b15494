from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.dimensions import DIMENSIONS
from labweb.domain.errors import Finding, ProtocolError, UnitError
from labweb.domain.units import parse, parse_volume_nl
from labweb.domain.workflows.workflow_edges import find_cycle, sort_steps
from labweb.domain.workflows.workflow_file import (
    bind_materials,
    check_workflow,
    parse_workflow,
    render_workflow,
    resolve_keys,
)
from tests.domain.workflows.bench import a_bench, chain, flow, id_of, step, transfer

TEMPLATES = Path(__file__).parents[3] / "fixtures" / "labs" / "starter" / "workflows"


def codes(value: object) -> list[str]:
    return [finding.code for finding in check_workflow(value)]


def the_finding(value: object) -> Finding:
    findings = check_workflow(value)
    assert len(findings) == 1, findings
    return findings[0]


def wait(step_id: str = "w", duration: object = "10 min", **rest: object) -> dict[str, Any]:
    return step(step_id, "wait", duration=duration) | rest


@pytest.mark.parametrize("path", sorted(TEMPLATES.glob("*.json")), ids=lambda path: path.stem)
def test_each_template_reads_and_renders_back_the_same(path: Path) -> None:
    value = json.loads(path.read_text(encoding="utf-8"))
    assert json.loads(json.dumps(render_workflow(parse_workflow(value)))) == value


def test_there_are_four_templates() -> None:
    names = {path.stem for path in TEMPLATES.glob("*.json")}
    assert names == {"move_water", "heat_and_stir", "dilution", "try_an_error"}


def test_keys_of_a_template_become_ids_of_the_lab() -> None:
    workflow = parse_workflow(flow(transfer("t", "water", "flask", "5 mL")))
    resolved = resolve_keys(workflow, a_bench().tree)
    assert resolved.steps[0].params["source"] == str(id_of("water"))
    assert resolved.steps[0].params["volume"] == "5 mL"


def test_a_key_the_lab_does_not_have_is_refused_with_step_and_field() -> None:
    workflow = parse_workflow(flow(transfer("t", "wine", "flask", "5 mL")))
    with pytest.raises(ProtocolError) as caught:
        resolve_keys(workflow, a_bench().tree)
    (finding,) = caught.value.findings
    assert finding.code == "protocol.unknown_key"
    assert (finding.subject, finding.context["field"]) == ("t", "params.source")


@pytest.mark.parametrize("value", [None, 3, "text", [], [{}]])
def test_anything_but_an_object_is_refused(value: object) -> None:
    assert codes(value) == ["protocol.not_object"]


def test_an_unknown_kind_is_refused_and_the_known_ones_are_named() -> None:
    finding = the_finding(flow(step("s", "distill")))
    assert (finding.code, finding.subject) == ("protocol.unknown_kind", "s")
    assert "transfer" in finding.message


@pytest.mark.parametrize(
    ("duration", "code"),
    [
        ("10 mL", "unit.unknown"),
        ("10", "unit.unknown"),
        ("-5 s", "unit.not_positive"),
        ("0 s", "unit.not_positive"),
        ("nan s", "unit.unreadable"),
        (600, "unit.not_text"),
        (float("nan"), "unit.not_text"),
        ("1,5 min", "unit.comma"),
        ("9e99 s", "unit.not_finite"),
        ("10001 h", "unit.too_large"),
        (None, "unit.not_text"),
        (True, "unit.not_text"),
    ],
)
def test_a_duration_that_is_none_is_refused_at_its_field(duration: object, code: str) -> None:
    finding = the_finding(flow(wait(duration=duration)))
    assert finding.code == code
    assert (finding.subject, finding.context["field"]) == ("w", "params.duration")


@pytest.mark.parametrize(
    ("volume", "code"),
    [("0 mL", "unit.not_positive"), ("-1 mL", "unit.not_positive"), ("0.5 nL", "unit.off_grid")]
    + [(f"{amount} mL", "unit.too_large") for amount in ("1e15", "10000001")],
)
def test_a_volume_that_cannot_be_poured_is_refused(volume: str, code: str) -> None:
    assert codes(flow(transfer("t", "water", "flask", volume))) == [code]


@pytest.mark.parametrize("unit", ["uL", "ul", "\u00b5L", "\u00b5l", "\u03bcL", "\u03bcl"])
def test_a_microlitre_reads_the_same_however_it_is_written(unit: str) -> None:
    assert parse_volume_nl(f"250 {unit}") == 250_000
    assert parse(f"3 {unit}/s", "flow_rate") == 3
    assert parse(f"180 {unit}/min", "flow_rate") == pytest.approx(3)


@pytest.mark.parametrize("name", sorted(DIMENSIONS))
def test_the_most_that_is_read_of_a_dimension_is_read_and_no_more(name: str) -> None:
    most = DIMENSIONS[name].most
    number, unit = most.split(" ")
    assert parse(most, name) > 0
    with pytest.raises(UnitError) as caught:
        parse(f"{int(number) + 1} {unit}", name)
    assert caught.value.code == "unit.too_large"


@pytest.mark.parametrize(
    ("reference", "is_one"),
    [
        ("@flask_3 M acid", True),
        ("@a", True),
        ("@", False),
        ("@ a", False),
        ("@a@b", False),
        ("@a\nb", False),
        ("a b", False),
        ("@" + 80 * "a", False),
    ],
)
def test_the_key_of_a_resource_may_have_blanks_within(reference: str, is_one: bool) -> None:
    found = codes(flow(step("h", "heat_chill", vessel=reference, temperature="50 °C")))
    assert found == ([] if is_one else ["protocol.bad_reference"])


def test_temperatures_may_be_negative_but_not_below_absolute_zero() -> None:
    cold = step("h", "heat_chill", vessel="@reactor", temperature="-78 °C")
    colder = step("h", "heat_chill", vessel="@reactor", temperature="-300 °C")
    assert codes(flow(cold)) == []
    assert codes(flow(colder)) == ["unit.out_of_range"]


def test_missing_and_unknown_parameters_are_all_listed() -> None:
    value = flow(step("t", "transfer", source="@water", colour="blue"))
    found = {(f.code, f.context["field"]) for f in check_workflow(value)}
    assert found == {
        ("protocol.unknown_param", "params.colour"),
        ("protocol.missing_param", "params.target"),
        ("protocol.missing_param", "params.volume"),
    }


@pytest.mark.parametrize("reference", ["water", "@", "", 3, None, "@ a", "{}" * 30])
def test_a_vessel_is_named_by_id_or_key_and_nothing_else(reference: object) -> None:
    value = flow(step("t", "transfer", source=reference, target="@flask", volume="1 mL"))
    assert codes(value) == ["protocol.bad_reference"]


def test_two_steps_may_not_share_an_id() -> None:
    assert codes(flow(wait(), wait())) == ["protocol.duplicate_id"]


def test_an_edge_to_nowhere_is_refused() -> None:
    assert codes(flow(wait("a"), edges=("a>b",))) == ["protocol.dangling_edge"]


def test_an_edge_at_a_port_the_step_has_not_is_refused() -> None:
    value = flow(wait("a"), wait("b"), edges=("a.value>b.start",))
    assert codes(value) == ["protocol.unknown_port"]


def test_ports_of_different_types_cannot_be_joined() -> None:
    weigh = step("a", "weigh", balance="@balance_1")
    value = flow(weigh, wait("b"), edges=("a.value>b.start",))
    finding = the_finding(value)
    assert finding.code == "protocol.port_types"
    assert "data" in finding.message


def test_steps_that_wait_for_each_other_are_refused_with_the_ring() -> None:
    value = flow(wait("a"), wait("b"), wait("c"), edges=("a>b", "b>c", "c>a"))
    finding = the_finding(value)
    assert finding.code == "protocol.cycle"
    assert sorted(finding.message.partition(": ")[2].split(" → ")[:-1]) == ["a", "b", "c"]


def test_a_step_that_waits_for_itself_is_a_ring() -> None:
    assert codes(flow(wait("a"), edges=("a>a",))) == ["protocol.cycle"]


def test_a_workflow_has_at_most_five_hundred_steps() -> None:
    assert codes(flow(*(wait(f"w{n}") for n in range(500)))) == []
    assert codes(flow(*(wait(f"w{n}") for n in range(501)))) == ["protocol.too_many_steps"]


def test_arguments_nested_too_deep_are_refused_before_anything_walks_them() -> None:
    args: dict[str, Any] = {}
    for _ in range(5000):
        args = {"in": args}
    value = flow(step("d", "device_action", device="@pump_1", action="initialize", args=args))
    assert codes(value) == ["protocol.too_deep"]


@pytest.mark.parametrize(
    ("args", "code"),
    [
        ({"x": float("nan")}, "protocol.not_finite"),
        ({"x": 10**400}, "protocol.not_finite"),
        ({"x": [float("inf")]}, "protocol.not_finite"),
        ({"x": "a" * 1001}, "protocol.too_long"),
        ({"x": list(range(201))}, "protocol.too_long"),
        ([], "protocol.not_object"),
    ],
)
def test_arguments_no_device_can_take_are_refused(args: object, code: str) -> None:
    value = flow(step("d", "device_action", device="@pump_1", action="initialize", args=args))
    assert codes(value) == [code]


@pytest.mark.parametrize(
    ("extra", "code"),
    [
        ({"note": "a" * 4001}, "protocol.too_long"),
        ({"position": {"x": float("nan"), "y": 0}}, "protocol.bad_position"),
        ({"position": [1, 2]}, "protocol.bad_position"),
        ({"colour": "red"}, "protocol.unknown_field"),
        ({"params": [1]}, "protocol.not_object"),
    ],
)
def test_a_step_with_a_wrong_field_is_refused(extra: dict[str, Any], code: str) -> None:
    finding = the_finding(flow(wait(**extra)))
    assert (finding.code, finding.subject) == (code, "w")


@pytest.mark.parametrize("name", ["", "  ", None, 3, "a" * 201])
def test_a_workflow_needs_a_name(name: object) -> None:
    assert codes(flow(wait()) | {"name": name})[0] in {
        "protocol.missing_field",
        "protocol.too_long",
    }


def test_another_schema_is_refused() -> None:
    assert codes(flow(wait()) | {"schema": "labweb.workflow/9"}) == ["protocol.unknown_schema"]


def test_every_reason_is_told_at_once() -> None:
    value = flow(wait("a", duration="x"), step("b", "boil"), edges=("a>c",))
    assert set(codes(value)) == {
        "unit.unreadable",
        "protocol.unknown_kind",
        "protocol.dangling_edge",
    }
    with pytest.raises(ProtocolError) as caught:
        parse_workflow(value)
    assert len(caught.value.findings) == 3


def test_a_material_edge_fills_the_vessel_through_a_whole_chain() -> None:
    stir = {"stir_speed": "400 rpm", "duration": "1 min"}
    value = flow(
        step("c", "stop_heat_stir"),
        step("b", "stir", **stir),
        transfer("a", "water", "reactor", "5 mL"),
        edges=("b.vessel>c.vessel", "a.target>b.vessel"),
    )
    bound = bind_materials(parse_workflow(value))
    assert [s.params["vessel"] for s in bound.steps[:2]] == ["@reactor", "@reactor"]


def test_a_material_edge_between_two_different_vessels_is_refused() -> None:
    stop = step("b", "stop_heat_stir", vessel="@flask")
    value = flow(transfer("a", "water", "reactor", "5 mL"), stop, edges=("a.target>b.vessel",))
    assert codes(value) == ["protocol.material_mismatch"]


def test_ids_of_resources_are_taken_as_they_are() -> None:
    value = flow(step("w", "weigh", balance=str(uuid4())))
    assert codes(value) == []


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(
                ["id", "kind", "params", "steps", "edges", "name", "source", "position"]
            )
            | st.text(max_size=4),
            inner,
            max_size=5,
        )
    ),
    max_leaves=25,
)


@settings(deadline=None)
@given(_JSON)
def test_no_json_makes_the_parser_fail_otherwise_than_by_findings(value: object) -> None:
    findings = check_workflow(value)
    if not findings:
        assert parse_workflow(value).name


@settings(deadline=None)
@given(_JSON, _JSON)
def test_no_step_or_edge_makes_the_parser_fail_otherwise(raw: object, edge: object) -> None:
    value = {"name": "Test", "steps": [wait("a"), raw], "edges": [edge]}
    assert isinstance(check_workflow(value), list)


@settings(deadline=None)
@given(st.integers(1, 8), st.sets(st.tuples(st.integers(0, 7), st.integers(0, 7)), max_size=14))
def test_order_and_rings_never_disagree(count: int, pairs: set[tuple[int, int]]) -> None:
    ids = [f"s{n}" for n in range(count)]
    edges = tuple(f"s{a}>s{b}" for a, b in sorted(pairs) if a < count and b < count)
    drawn = flow(*(wait(i) for i in ids), edges=edges)
    found = [f for f in check_workflow(drawn) if f.code == "protocol.cycle"]
    has_ring = any(_reaches_itself(i, edges) for i in ids)
    assert bool(found) == has_ring
    if not found:
        workflow = parse_workflow(drawn)
        order = sort_steps(ids, workflow.edges)
        assert sorted(order) == sorted(ids)
        assert all(order.index(e.source) < order.index(e.target) for e in workflow.edges)
        assert find_cycle(ids, workflow.edges) == []


def _reaches_itself(start: str, edges: tuple[str, ...]) -> bool:
    reached: set[str] = set()
    frontier = {start}
    while frontier:
        frontier = {e.split(">")[1] for e in edges if e.split(">")[0] in frontier} - reached
        reached |= frontier
    return start in reached


def test_a_chain_is_ordered_by_its_edges() -> None:
    workflow = parse_workflow(chain(wait("z"), wait("a"), wait("m")))
    assert sort_steps(["a", "m", "z"], workflow.edges) == ["z", "a", "m"]
