from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from labweb.domain.graph.elements import Element, ElementRole, Tube
from labweb.domain.graph.port_network import Network, explore
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.graph.syringe_chain import WantedChain, find_chain
from labweb.domain.workflows.passes.liquids.stroke_pipeline import find_interval

ROLES = {
    "v": ElementRole.VALVE, "p": ElementRole.PUMP, "s": ElementRole.SOLENOID,
    "m": ElementRole.MANIFOLD,
    "c": ElementRole.CARTRIDGE, "f": ElementRole.VESSEL,
}  # fmt: skip


def network(*tubes: str, dead: Iterable[int] = (), **more: dict[str, Any]) -> Network:
    """Draw `"f1:0 > v1:3"` one way or with `=` both; the first letter is the role."""
    drawn: list[Tube] = []
    keys: dict[str, None] = {}
    amounts = list(dead)
    for place, text in enumerate(tubes):
        sign = "=" if "=" in text else ">"
        (one, _, a), (two, _, b) = (end.strip().partition(":") for end in text.split(sign))
        keys |= {one: None, two: None}
        drawn.append(
            Tube(
                key=f"t{place}",
                source=one,
                source_port=a,
                target=two,
                target_port=b,
                medium=Medium.LIQUID,
                is_two_way=sign == "=",
                dead_volume_nl=amounts[place] if amounts else None,
            )
        )
    elements = [
        Element(
            key=key,
            role=ROLES[key[0]],
            common_port="c" if key[0] == "v" else None,
            capacity_nl=1000 if key[0] == "p" else None,
            **more.get(key, {}),
        )
        for key in keys
    ]
    return Network(elements, drawn)


def hops(net: Network, start: str, *passable: str) -> list[str]:
    through = frozenset(net.index[key] for key in passable)
    return [
        " ".join(f"{net.elements[index].key}:{port}" for index, port in hop.ports)
        for hop in explore(net, net.index[start], passable=through)
    ]


def way(net: Network, source: str, target: str, **more: Any) -> list[str] | None:  # noqa: ANN401
    chain = find_chain(net, WantedChain(source=net.index[source], target=net.index[target], **more))
    return None if chain is None else [net.elements[pump].key for pump in chain.pumps]


def test_a_hop_ends_at_each_port_that_a_syringe_can_push_to() -> None:
    net = network("p1:0 = v1:c", "v1:1 = f1:a", "v1:2 = f1:b", "v1:3 > v2:c", "v2:1 = f2:a")
    assert hops(net, "p1") == [
        "p1:0 v1:c v1:1 f1:a",
        "p1:0 v1:c v1:2 f1:b",
        "p1:0 v1:c v1:3 v2:c v2:1 f2:a",
    ]


def test_a_vessel_is_left_by_each_of_its_ports() -> None:
    net = network("f1:a > v1:1", "f1:b > v1:2", "v1:c = p1:0", "v1:3 > f2:a")
    chain = find_chain(
        net, WantedChain(source=net.index["f1"], target=net.index["f2"], source_port="b")
    )
    assert chain is not None
    assert chain.hops[0].settings == ((net.index["v1"], "2"),)


def test_drawing_and_pushing_divide_at_different_ports() -> None:
    one_in_one_out = network("f1:0 > v1:1", "v1:1 > f2:0", "v1:c = p1:0", "v1:2 = f3:0")
    assert way(one_in_one_out, "f1", "f3") == ["p1"]
    assert way(one_in_one_out, "f3", "f2") == ["p1"]
    two_out = network("f1:0 > v1:1", "v1:2 > f2:0", "v1:2 > f3:0", "v1:c = p1:0")
    assert way(two_out, "f1", "f2") is None


def test_two_ports_of_one_vessel_on_one_valve_port_are_one_vessel() -> None:
    net = network("f1:0 > v1:1", "v1:2 > f2:top", "v1:2 > f2:bottom", "v1:c = p1:0")
    assert way(net, "f1", "f2") == ["p1"]


def test_a_syringe_without_a_valve_takes_part_only_when_its_tubes_conduct_one_way_each() -> None:
    assert way(network("f1:0 > p1:in", "p1:out > f2:0"), "f1", "f2") == ["p1"]
    assert way(network("f1:0 = p1:in", "p1:out = f2:0"), "f1", "f2") is None
    selecting = network("f1:0 = p1:in", "p1:out = f2:0", p1={"selects": True})
    assert way(selecting, "f1", "f2") == ["p1"]


def test_a_solenoid_with_three_tubes_does_not_conduct() -> None:
    two = network("f1:0 > v1:1", "v1:c = p1:0", "v1:2 = s1:in", "s1:out = f2:0")
    assert way(two, "f1", "f2") == ["p1"]
    three = network("f1:0 > v1:1", "v1:c = p1:0", "v1:2 = s1:in", "s1:out = f2:0", "s1:more = f3:0")
    assert way(three, "f1", "f2") is None


def test_no_valve_stands_at_two_positions_in_one_hop() -> None:
    # A loop of one valve: both pairs in one position conduct, each in its own does not.
    tubes = ("p1:0 = v1:1", "v1:2 = v2:1", "v2:c = v1:3", "v1:4 = f1:0")
    both = {"a": frozenset({frozenset("12"), frozenset("34")})}
    looped = network(*tubes, v1={"positions": both})
    assert hops(looped, "p1") == ["p1:0 v1:1 v1:2 v2:1 v2:c v1:3 v1:4 f1:0"]
    torn = {"a": frozenset({frozenset("12")}), "b": frozenset({frozenset("34")})}
    assert hops(network(*tubes, v1={"positions": torn}), "p1") == []


def test_dead_volume_counts_more_than_syringes_and_syringes_more_than_tubes() -> None:
    tubes = (
        "f1:0 > v1:1", "v1:c = p1:0", "v1:2 = f2:0", "v1:3 = v2:1", "v2:c = p2:0", "v2:2 = f2:1"
    )  # fmt: skip
    assert way(network(*tubes, dead=(1, 1, 50, 1, 1, 1)), "f1", "f2") == ["p1", "p2"]
    assert way(network(*tubes, dead=(1, 1, 1, 1, 1, 1)), "f1", "f2") == ["p1"]
    assert way(network(*tubes), "f1", "f2") == ["p1"]


def test_a_manifold_and_a_cartridge_are_passed_only_when_asked() -> None:
    net = network(
        "f1:0 > v1:1", "v1:c = p1:0", "v1:2 > c1:in", "v1:3 > c2:in", "c1:out > m1:0",
        "c2:out > m1:0", "m1:0 > f2:0",
    )  # fmt: skip
    assert way(net, "f1", "f2") is None
    for key in ("c1", "c2"):
        wanted = WantedChain(
            source=net.index["f1"], target=net.index["f2"], through=(net.index[key],)
        )
        chain = find_chain(net, wanted)
        assert chain is not None
        assert net.index[key] in chain.hops[-1].passed
    assert way(net, "f1", "f2", through=(net.index["c1"], net.index["c2"])) is None


def test_strokes_follow_each_other_as_closely_as_what_they_share_allows() -> None:
    tubes = ["f1:0 > v0:1", "v0:c = p0:0"]
    for n in range(4):
        tubes += [f"v{n}:2 = v{n + 1}:1", f"v{n + 1}:c = p{n + 1}:0"]
    net = network(*tubes, "v4:3 > f2:0", "v0:3 > f3:0")
    far = find_chain(net, WantedChain(source=net.index["f1"], target=net.index["f2"]))
    near = find_chain(net, WantedChain(source=net.index["f1"], target=net.index["f3"]))
    assert far is not None
    assert near is not None
    assert (len(far.hops), find_interval(far.hops)) == (6, 2)
    assert (len(near.hops), find_interval(near.hops)) == (2, 2)
    assert find_interval((*far.hops, far.hops[0])) == 4


def test_what_is_known_of_hops_does_not_grow_without_end() -> None:
    net = network(
        "f1:0 > v1:1", "v1:c = p1:0", "v1:2 > f2:0", *(f"m{n}:0 > f2:1" for n in range(80))
    )
    for n in range(80):
        way(net, "f1", "f2", through=(net.index[f"m{n}"],))
    assert len(net.tables) <= 64
