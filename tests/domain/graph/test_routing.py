from __future__ import annotations

import pytest
import rustworkx
from hypothesis import given, settings
from hypothesis import strategies as st

from labweb.domain.errors import NoRouteError
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.routing import Route, ValvePosition, find_route
from tests.domain.workflows.bench import Bench, id_of


def route(bench: Bench, source: str, target: str, *, blocked: tuple[str, ...] = ()) -> Route:
    ids = {id_of(key) for key in blocked}
    return find_route(bench.graph, bench.tree, id_of(source), id_of(target), blocked=ids)


def refusal(bench: Bench, source: str, target: str) -> NoRouteError:
    with pytest.raises(NoRouteError) as caught:
        route(bench, source, target)
    return caught.value


def vessels(*keys: str) -> Bench:
    bench = Bench()
    for key in keys:
        bench.vessel(key, 1_000_000)
    return bench


def test_a_route_passes_a_rotary_valve_and_says_which_port_it_must_face() -> None:
    # water ── 3│valve│common ── pump
    bench = vessels("water")
    bench.pump(1, {3: ("water", 40_000)})
    found = route(bench, "water", "pump_1")
    assert found.valves == (ValvePosition(id_of("valve_1"), 3),)
    assert found.dead_volume_nl == 40_000
    assert found.resource_ids == (id_of("water"), id_of("valve_1"), id_of("pump_1"))


def test_two_numbered_ports_of_a_valve_are_never_joined() -> None:
    # water ── 1│valve│2 ── flask
    bench = vessels("water", "flask")
    bench.pump(1, {1: ("water", 0), 2: ("flask", 0)})
    assert refusal(bench, "water", "flask").code == "plan.no_route"


def test_the_common_port_may_have_another_name() -> None:
    bench = vessels("water", "flask")
    bench.add("valve", "rotary_valve", config={"common_port": "-1"})
    bench.tube("water:", "valve:2")
    bench.tube("valve:-1", "flask:")
    assert route(bench, "water", "flask").valves == (ValvePosition(id_of("valve"), 2),)


def test_the_least_dead_volume_wins_over_fewer_connections() -> None:
    # water ── 500 ── flask,  water ── 10 ── 1│valve│common ── 10 ── flask
    bench = vessels("water", "flask")
    bench.tube("water:a", "flask:a", 500)
    bench.add("valve", "rotary_valve")
    bench.tube("water:b", "valve:1", 10)
    bench.tube("valve:common", "flask:b", 10)
    found = route(bench, "water", "flask")
    assert found.dead_volume_nl == 20
    assert len(found.connections) == 2


def test_equal_routes_are_decided_by_port_names_whatever_the_order_of_the_file() -> None:
    bench = vessels("water", "flask")
    for port in ("b", "a", "c"):
        bench.tube(f"water:{port}", f"flask:{port}", 10)
    first = route(bench, "water", "flask")
    bench.connections.reverse()
    assert first.ports[0].port == "a"
    assert route(bench, "water", "flask") == first


def test_unknown_dead_volume_costs_nothing_and_is_listed() -> None:
    bench = vessels("water", "flask")
    bench.tube("water:a", "flask:a", None)
    found = route(bench, "water", "flask")
    assert found.dead_volume_nl == 0
    assert found.unknown_keys == ("tube_0",)


def test_a_check_valve_conducts_one_way() -> None:
    bench = vessels("water", "flask")
    bench.tube("water:", "flask:", two_way=False)
    assert route(bench, "water", "flask").connections
    error = refusal(bench, "flask", "water")
    assert error.context["reached"] == []
    assert error.context["reaches_target"] == []


def test_only_liquid_connections_carry_liquid() -> None:
    bench = vessels("water", "flask")
    bench.tube("water:", "flask:", medium=Medium.COMMUNICATION)
    bench.tube("water:", "flask:", medium=Medium.OTHER)
    assert refusal(bench, "water", "flask").code == "plan.no_route"


def test_a_vessel_in_between_is_not_passed_through() -> None:
    bench = vessels("water", "trap", "flask")
    bench.tube("water:", "trap:in")
    bench.tube("trap:out", "flask:")
    error = refusal(bench, "water", "flask")
    assert error.context["reached"] == ["trap"]
    assert error.context["reaches_target"] == ["trap"]


def test_a_refusal_names_both_sides_of_the_gap() -> None:
    # water ── 1│valve 1│common      valve 2│common ── flask
    bench = vessels("water", "flask")
    bench.add("valve_1", "rotary_valve")
    bench.add("valve_2", "rotary_valve")
    bench.tube("water:", "valve_1:1")
    bench.tube("valve_2:common", "flask:")
    error = refusal(bench, "water", "flask")
    assert error.context["reached"] == ["valve_1"]
    assert error.context["reaches_target"] == ["valve_2"]
    assert "Valve 1" in error.message
    assert "Valve 2" in error.message


def test_a_solenoid_valve_on_the_only_way_is_refused_by_name() -> None:
    bench = vessels("water", "flask")
    bench.add("gate", "solenoid_valve")
    bench.tube("water:", "gate:in")
    bench.tube("gate:out", "flask:")
    error = refusal(bench, "water", "flask")
    assert error.code == "plan.undriven_valve"
    assert error.context["valves"] == ["gate"]
    assert "Gate" in error.message


def test_a_blocked_resource_is_gone_around() -> None:
    bench = vessels("water", "flask")
    for number, dead in ((1, 10), (2, 20)):
        bench.add(f"valve_{number}", "rotary_valve")
        bench.tube(f"water:{number}", f"valve_{number}:1", dead)
        bench.tube(f"valve_{number}:common", f"flask:{number}", dead)
    assert route(bench, "water", "flask").dead_volume_nl == 20
    assert route(bench, "water", "flask", blocked=("valve_1",)).dead_volume_nl == 40


def test_a_tee_on_a_valve_port_is_not_used_because_the_flow_would_divide() -> None:
    bench = vessels("water", "acid", "flask")
    bench.add("valve", "rotary_valve")
    bench.tube("water:", "valve:1")
    bench.tube("acid:", "valve:1")
    bench.tube("valve:common", "flask:")
    error = refusal(bench, "water", "flask")
    assert error.context["tees"] == ["valve:1"]


def test_one_valve_is_never_asked_to_stand_at_two_ports() -> None:
    # water ── 1│v│common ── 1│w│common ── 2│v: what flows on needs v at 1 and at 2 at once
    bench = vessels("water", "flask")
    bench.add("v", "rotary_valve")
    bench.add("w", "rotary_valve")
    bench.tube("water:", "v:1", 1)
    bench.tube("v:common", "w:1", 1)
    bench.tube("w:common", "v:2", 1)
    bench.tube("v:3", "flask:", 1)
    assert refusal(bench, "water", "flask").code == "plan.no_route"


@settings(max_examples=60, deadline=None)
@given(
    joints=st.sets(st.tuples(st.integers(0, 4), st.integers(0, 4), st.integers(1, 4)), max_size=12),
    start=st.integers(0, 4),
    seed=st.integers(0, 10_000),
)
def test_cost_agrees_with_an_independent_shortest_path(
    joints: set[tuple[int, int, int]], start: int, seed: int
) -> None:
    # Each valve's common port leads on to numbered ports of later valves: no ring, no tee.
    bench = vessels("flask", "water")
    for number in range(5):
        bench.add(f"v{number}", "rotary_valve")
    graph: rustworkx.PyDiGraph[str, int] = rustworkx.PyDiGraph()
    nodes = {name: graph.add_node(name) for name in ("water", *(f"v{n}" for n in range(5)))}
    used: set[tuple[str, str]] = set()
    for place, (source, target, port) in enumerate(sorted(joints)):
        dead = (seed * 31 + place * 17) % 97
        ends = {(f"v{source}", "common"), (f"v{target}", str(port))}
        if source >= target or ends & used:
            continue
        used |= ends
        bench.tube(f"v{source}:common", f"v{target}:{port}", dead)
        graph.add_edge(nodes[f"v{source}"], nodes[f"v{target}"], dead)
    bench.tube("water:", f"v{start}:9", 3)
    graph.add_edge(nodes["water"], nodes[f"v{start}"], 3)
    if ("v4", "common") not in used:
        bench.tube("v4:common", "flask:", 5)
    lengths = rustworkx.dijkstra_shortest_path_lengths(graph, nodes["water"], float)
    if nodes["v4"] in lengths and ("v4", "common") not in used:
        assert route(bench, "water", "flask").dead_volume_nl == lengths[nodes["v4"]] + 5
    else:
        refusal(bench, "water", "flask")
