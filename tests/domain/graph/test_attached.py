"""What is tied to the rest of the lab stays where it is; what is tied to itself comes along."""

from __future__ import annotations

from uuid import UUID

import pytest

from labweb.domain.graph.attachments import LOOSE, check_loose, find_attachments, that_hold
from labweb.domain.graph.ports_and_connections import Connection, Medium, PortRef

RACK, VIAL, VALVE = UUID(int=1), UUID(int=2), UUID(int=3)


def link(source: UUID, target: UUID, medium: Medium = Medium.LIQUID, key: str = "k") -> Connection:
    ends = PortRef(source, "out"), PortRef(target, "in")
    return Connection(id=UUID(int=9), key=key, medium=medium, source=ends[0], target=ends[1])


@pytest.mark.parametrize("medium", Medium)
def test_only_what_stands_there_is_loose(medium: Medium) -> None:
    found = find_attachments([link(VALVE, VIAL, medium)], {RACK, VIAL})
    assert len(found) == 1
    assert bool(that_hold(found)) == (medium not in LOOSE)
    assert bool(check_loose("Vial", str(VIAL), found)) == (medium not in LOOSE)
    assert {Medium.MECHANICAL, Medium.TRANSPORT} == LOOSE


def test_both_directions_hold_and_each_end_is_named() -> None:
    out, back = link(VIAL, VALVE, key="b"), link(VALVE, VIAL, key="a")
    first, second = find_attachments([out, back], {VIAL})
    assert (first.key, first.own, first.other) == ("a", back.target, back.source)
    assert (second.key, second.own, second.other) == ("b", out.source, out.target)


@pytest.mark.parametrize("ends", [(RACK, VIAL), (VIAL, VIAL), (VALVE, VALVE)])
def test_a_link_inside_or_elsewhere_holds_nothing(ends: tuple[UUID, UUID]) -> None:
    assert find_attachments([link(*ends)], {RACK, VIAL}) == ()


def test_the_refusal_names_every_connection() -> None:
    held = find_attachments(
        [link(VALVE, VIAL, key="a"), link(VIAL, VALVE, Medium.GAS, "b")], {VIAL}
    )
    (finding,) = check_loose("Vial", str(VIAL), held)
    assert finding.code == "crutd.connected"
    assert finding.message == "Vial is connected and cannot be carried: a (liquid), b (gas)"
    named = finding.context["connections"]
    assert [one["key"] for one in named] == ["a", "b"]
    assert named[0]["other_id"] == str(VALVE)
    assert check_loose("Vial", str(VIAL), ()) == []
