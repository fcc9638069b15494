"""What is feasible, told by small drawings, and held against settings tried at random."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests.judge.bench import bench
from tests.judge.flow import Sense, joined_to
from tests.judge.invent import invent
from tests.judge.oracle import Answer, Oracle
from tests.judge.reading import read_rig
from tests.judge.request import Request
from tests.judge.rig import Device, Hose, Kind, Rig

SEEDS = range(40)
_NAMES = {"V": Kind.VALVE, "P": Kind.PUMP, "S": Kind.SOLENOID, "Q": Kind.PUMP_VALVE}
_NAMES |= {"G": Kind.OTHER}


def drawn(text: str) -> Rig:
    """Return a rig of hoses `A V1:1`; the first letter tells the kind, else it is a vessel.

    `V1:c P1` joins the common port; `A > V1:1` is drawn one way only.
    """
    hoses, ends = [], set()
    for line in text.strip().splitlines():
        first, *arrow, second = line.split()
        a, b = (_end(word) for word in (first, second))
        hoses.append(Hose(a, b, is_backward=not arrow))
        ends |= {a[0], b[0]}
    return Rig({name: _device(name) for name in sorted(ends)}, tuple(hoses))


def _end(word: str) -> tuple[str, str]:
    name, _, port = word.partition(":")
    return name, port or "0"


def _device(name: str) -> Device:
    kind = _NAMES.get(name[0], Kind.VESSEL)
    return Device(name, kind, capacity_nl=10_000_000, common="c", declared=frozenset("123456"))


def ask(text: str, source: str = "A", target: str = "B") -> Answer:
    return Oracle(drawn(text)).ask(Request(source, target, 1_000_000)).answer


def test_a_pump_at_the_common_port_serves_all_outer_ports() -> None:
    assert ask("A V:1\nB V:2\nV:c P") is Answer.FEASIBLE


@pytest.mark.parametrize("pump", ["", "\nV:3 P"])
def test_a_rotary_valve_never_joins_two_outer_ports(pump: str) -> None:
    assert ask("A V:1\nB V:2" + pump) is Answer.INFEASIBLE


def test_a_pump_on_an_outer_port_reaches_what_is_on_the_common_one_and_no_more() -> None:
    assert ask("V:1 P\nV:c A\nV:2 B") is Answer.INFEASIBLE


def test_valves_that_face_each_other_pass_from_pump_to_pump() -> None:
    """A ─ 2 V1 1 ─ 2 V2 3 ─ B, a pump on each."""
    assert ask("A V1:2\nV1:c P1\nV1:1 V2:2\nV2:c P2\nV2:3 B") is Answer.FEASIBLE


def test_a_backbone_breaks_where_a_valve_has_no_pump() -> None:
    """A ─ 2 V1 1 ─ 2 V2 1 ─ 2 V3 3 ─ B, no pump on V2."""
    rig = "A V1:2\nV1:c P1\nV1:1 V2:2\nV2:1 V3:2\nV3:c P3\nV3:3 B"
    assert ask(rig) is Answer.INFEASIBLE
    finding = Oracle(drawn(rig)).ask(Request("A", "B", 1))
    assert "V2" in finding.break_ids
    assert ask(rig + "\nV2:c P2") is Answer.FEASIBLE


def test_a_valve_without_a_pump_is_passed_through_its_common_port() -> None:
    assert ask("P V1:c\nV1:3 V2:c\nV2:1 A\nV2:2 B") is Answer.FEASIBLE


def test_a_pump_in_line_needs_something_that_shuts_on_both_sides() -> None:
    assert ask("A S1:1\nS1:2 P:a\nP:b S2:1\nS2:2 B") is Answer.FEASIBLE
    assert ask("A S1:1\nS1:2 P:a\nP:b B") is Answer.INFEASIBLE
    assert ask("A P:a\nP:b B") is Answer.INFEASIBLE


def test_a_port_without_a_hose_shuts_nothing() -> None:
    rig = "A V1:1\nV1:c P:a\nP:b V2:c\nV2:1 B"
    assert ask(rig) is Answer.INFEASIBLE
    shut = "\nV1:2 S1:1\nS1:2 C\nV2:2 S2:1\nS2:2 D"
    assert ask(rig + shut) is Answer.FEASIBLE


def test_a_hose_that_ends_at_a_valve_standing_elsewhere_is_shut() -> None:
    """The pump's second hose ends on port 1 of V2, which can stand on 2."""
    assert ask("A V1:1\nB V1:2\nV1:c P:a\nP:b V2:1\nV2:c C") is Answer.FEASIBLE


def test_a_syringe_with_its_own_valve_needs_no_other() -> None:
    assert ask("A Q:1\nB Q:2") is Answer.FEASIBLE
    assert ask("A Q1:1\nQ1:3 Q2:4\nQ2:2 B") is Answer.FEASIBLE


def test_a_vessel_on_the_path_breaks_it() -> None:
    assert ask("A V1:1\nV1:c P1\nV1:2 C\nC V2:1\nV2:c P2\nV2:2 B") is Answer.INFEASIBLE


def test_what_is_no_vessel_and_no_valve_breaks_a_path() -> None:
    assert ask("A V:1\nV:c P\nV:2 G\nG B") is Answer.INFEASIBLE


def test_a_one_way_hose_is_followed_one_way() -> None:
    rig = "A > V:1\nV:2 > B\nV:c P"
    assert ask(rig) is Answer.FEASIBLE
    assert ask(rig, "B", "A") is Answer.INFEASIBLE


def test_two_pumps_on_one_common_port_leave_the_answer_open() -> None:
    assert ask("A V:1\nB V:2\nV:c P1:a\nP1:b P2") is Answer.OPEN


def test_a_pump_of_unknown_volume_is_none() -> None:
    rig = drawn("A V:1\nB V:2\nV:c P")
    unknown = {**rig.devices, "P": Device("P", Kind.PUMP)}
    found = Oracle(Rig(unknown, rig.hoses)).ask(Request("A", "B", 1))
    assert found.answer is Answer.INFEASIBLE


def test_ports_that_were_asked_for_count() -> None:
    oracle = Oracle(drawn("A:top V:1\nA:bottom V:3\nB V:2\nV:c P"))
    ports = {"top": Answer.FEASIBLE, "bottom": Answer.FEASIBLE, "side": Answer.INFEASIBLE}
    for port, answer in ports.items():
        assert oracle.ask(Request("A", "B", 1, from_port=port)).answer is answer


def test_the_bench_is_feasible_where_its_drawing_says() -> None:
    oracle = Oracle(bench())
    islands = ("ABCJDEFG", "HI")
    vessels = "ABCDEFGHIJL"
    for a in vessels:
        for b in vessels:
            if a != b:
                can = any(a in island and b in island for island in islands)
                found = oracle.ask(Request(a, b, 1)).answer
                assert found is (Answer.FEASIBLE if can else Answer.INFEASIBLE), (a, b)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_setting_joins_what_the_oracle_keeps_apart(seed: int, tmp_path: Path) -> None:
    rig = read_rig(invent(seed, 0).write(tmp_path))
    oracle, dice = Oracle(rig), random.Random(seed)
    known = {
        sense: {(leg.pump, leg.other, leg.ports) for legs in table.values() for leg in legs}
        for sense, table in ((Sense.DRAW, oracle.draws), (Sense.PUSH, oracle.pushes))
    }
    passes = {(leg.pump, leg.other) for legs in oracle.passes.values() for leg in legs}
    for _ in range(60):
        positions = {name: dice.choice(ports) for name, ports in _selectable(rig) if ports}
        solenoids = [one.id for one in rig.devices.values() if one.kind is Kind.SOLENOID]
        opened = {name for name in solenoids if dice.random() < 0.5}
        for pump in rig.pumps():
            for sense in Sense:
                joined = joined_to(rig, pump, sense, positions, opened)
                names = joined.vessel_ids()
                if joined.strays or len(names) > 1:
                    continue
                ports = frozenset(port for _, port in joined.vessels)
                for name in names:
                    assert (pump, name, ports) in known[sense]
                if sense is Sense.PUSH and not names:
                    _check_passes(rig, pump, joined.pumps, passes, positions, opened)


def _selectable(rig: Rig) -> list[tuple[str, list[str]]]:
    kinds = {Kind.VALVE, Kind.PUMP_VALVE}
    return [(one.id, rig.outer_ports(one.id)) for one in rig.devices.values() if one.kind in kinds]


def _check_passes(
    rig: Rig,
    pump: str,
    partners: set[str],
    passes: set[tuple[str, str]],
    positions: dict[str, str],
    opened: set[str],
) -> None:
    for partner in partners:
        back = joined_to(rig, partner, Sense.DRAW, positions, opened)
        if pump in back.pumps and not back.vessels and not back.strays:
            assert (pump, partner) in passes


def breaks(text: str, **asked: str) -> frozenset[str]:
    return Oracle(drawn(text)).ask(Request("A", "B", 1, **asked)).break_ids


def test_a_way_breaks_at_a_syringe_that_is_open_to_several_things() -> None:
    """A ─ S1 ─ P ─ S2 ─ B, and P ─ C with nothing that shuts it; D ─ 1 V 2 ─ E stands apart."""
    found = breaks("A S1:1\nS1:2 P:a\nP:b S2:1\nS2:2 B\nP:d C\nD V:1\nV:2 E\nV:c P9")
    assert {"P", "S1", "S2"} <= found
    assert not {"C", "D", "E", "V", "P9"} & found


def test_a_vessel_that_no_syringe_joins_by_the_port_that_was_asked_for_is_a_break() -> None:
    """A ─ 1 V 2 ─ x B y ─ C, a pump on V: B is filled by x, and by y from C alone."""
    text = "A V:1\nV:c P\nV:2 B:x\nB:y C"
    assert Oracle(drawn(text)).ask(Request("A", "B", 1)).answer is Answer.FEASIBLE
    assert "B" in breaks(text, to_port="y")
