"""What the oracle calls feasible can be played, on the graphs of others and on invented ones."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from tests.corpus import NO_GRAPHS
from tests.judge.corpora import FOLDERS, INVENTED, IS_SOAK, LABS, PER_GRAPH, RIGS, SAMPLED, label
from tests.judge.harness import Line, Tally, judge_all, pairs, sample, wet_graphs
from tests.judge.invent import invent
from tests.judge.oracle import Answer, Oracle
from tests.judge.reading import read_json, read_rig
from tests.judge.request import Request
from tests.judge.rig import Rig
from tests.judge.verdict import Mark
from tests.judge.witness import answer_plainly

needs_graphs = pytest.mark.skipif(not LABS.is_dir() or not RIGS.is_dir(), reason=NO_GRAPHS)
pytestmark = pytest.mark.timeout(0 if IS_SOAK else 600)


def judged(rig: Rig, where: str, lines: list[Line]) -> Tally:
    oracle = Oracle(rig)
    return judge_all(rig, where, lines, [answer_plainly(oracle, line) for line in lines])


@needs_graphs
def test_plain_answers_pass_on_every_graph() -> None:
    tally = Tally()
    graphs = wet_graphs(FOLDERS)
    assert len(graphs) >= 150
    for path in graphs[::SAMPLED]:
        rig = read_rig(path)
        lines = pairs(rig)
        asked = lines if PER_GRAPH is None else sample(lines, PER_GRAPH, label(path))
        tally.merge(judged(rig, label(path), asked))
    assert not tally.wrong, tally.report()
    assert min(tally.marks[mark] for mark in (Mark.RIGHT_PLAN, Mark.RIGHT_REFUSAL)) > 50


def test_plain_answers_pass_on_invented_rigs(tmp_path: Path) -> None:
    tally = Tally()
    for seed in INVENTED:
        invented = invent(seed)
        rig = read_rig(invented.write(tmp_path))
        tally.merge(judged(rig, f"rig {seed}", invented.lines))
    assert not tally.wrong, tally.report()
    assert min(tally.marks[mark] for mark in (Mark.RIGHT_PLAN, Mark.RIGHT_REFUSAL)) > 50


@needs_graphs
def test_a_station_is_feasible_where_hoses_and_valves_say() -> None:
    """Counts made by hand from the drawing of the station: 9 vessels on two valves."""
    rig = read_rig(LABS / "comprehensive_protocol/comprehensive_station.json")
    oracle = Oracle(rig)
    hosed = ["reagent_bottle_1", "reagent_bottle_2", "reagent_bottle_3", "rotavap_1"]
    hosed += ["main_reactor", "waste_bottle_1", "separator_1", "reagent_bottle_4"]
    hosed += ["reagent_bottle_5"]
    for a in rig.vessels():
        for b in rig.vessels():
            if a != b:
                can = a in hosed and b in hosed
                found = oracle.ask(Request(a, b, 10_000_000)).answer
                assert found is (Answer.FEASIBLE if can else Answer.INFEASIBLE), (a, b)


@needs_graphs
def test_stations_whose_pump_has_many_bare_hoses_can_do_nothing() -> None:
    names = ("centrifuge", "cleanvessel", "filter", "filterthrough", "heatchill", "runcolumn")
    for name in (*names, "stir", "transfer"):
        rig = read_rig(LABS / f"mock_protocol/{name}teststation.json")
        oracle = Oracle(rig)
        answers = {
            oracle.ask(Request(str(line["from"]), str(line["to"]), 1)).answer for line in pairs(rig)
        }
        assert answers == {Answer.INFEASIBLE}, name


def test_a_long_backbone_is_answered() -> None:
    """flask ─ 0 V0 1 ─ 2 V1 1 ─ … ─ 2 V199 0 ─ flask, a pump on every valve; 1000 in a soak."""
    count = 1000 if IS_SOAK else 200
    nodes: list[dict[str, object]] = []
    links: list[tuple[str, str, str, str]] = []
    for number in range(count):
        nodes.append({"id": f"v{number}", "class": "ChemputerValve"})
        nodes.append({"id": f"p{number}", "class": "ChemputerPump", "max_volume": 10})
        links.append((f"v{number}", f"p{number}", "-1", "0"))
        if number:
            links.append((f"v{number - 1}", f"v{number}", "1", "2"))
    for name, number in (("a", 0), ("b", count - 1)):
        nodes.append({"id": name, "class": "ChemputerFlask"})
        links.append((f"v{number}", name, "0", "0"))
    both = [*links, *((b, a, pb, pa) for a, b, pa, pb in links)]
    edges = [{"source": a, "target": b, "port": f"({pa},{pb})"} for a, b, pa, pb in both]
    rig = read_json({"nodes": nodes, "links": edges})
    tally = judged(rig, "backbone", [{"from": "a", "to": "b", "volume": "60 mL"}])
    assert tally.marks == Counter({Mark.RIGHT_PLAN: 1})


@needs_graphs
def test_open_answers_are_few() -> None:
    """Where either answer is accepted the judge proves little: those must stay a small part."""
    counts = dict.fromkeys(Answer, 0)
    for path in wet_graphs(FOLDERS)[::SAMPLED]:
        rig = read_rig(path)
        oracle = Oracle(rig)
        for line in sample(pairs(rig, ["1 mL"]), 50, label(path)):
            counts[oracle.ask(Request(str(line["from"]), str(line["to"]), 1)).answer] += 1
    assert counts[Answer.OPEN] < sum(counts.values()) / 10
