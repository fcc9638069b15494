"""The compiler's own claims, judged by code that shares nothing with it.

Every graph of others and 200 invented rigs for each seed, every ordered pair of vessels at three
volumes with `LABWEB_SOAK`; a sample of them otherwise.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.corpus import NO_GRAPHS
from tests.judge.corpora import FOLDERS, INVENTED, LABS, PER_GRAPH, RIGS, SAMPLED, label
from tests.judge.harness import Line, Tally, ask_compiler, judge_all, pairs, sample, wet_graphs
from tests.judge.invent import invent
from tests.judge.reading import read_rig
from tests.judge.verdict import Mark

pytestmark = [pytest.mark.slow, pytest.mark.timeout(0)]
needs_graphs = pytest.mark.skipif(not LABS.is_dir() or not RIGS.is_dir(), reason=NO_GRAPHS)


def compiled(path: Path, lines: list[Line], scratch: Path) -> Tally:
    rig = read_rig(path)
    return judge_all(rig, path.name, lines, ask_compiler(path, lines, scratch))


@needs_graphs
def test_no_transfer_is_wrong_on_the_graphs_of_others(tmp_path: Path) -> None:
    tally = Tally()
    for path in wet_graphs(FOLDERS)[::SAMPLED]:
        lines = pairs(read_rig(path))
        asked = lines if PER_GRAPH is None else sample(lines, PER_GRAPH, label(path))
        tally.merge(compiled(path, asked, tmp_path))
    print(tally.report())  # noqa: T201 - the counts go into the record of a soak
    assert not tally.wrong, tally.report()
    assert tally.marks[Mark.RIGHT_PLAN] > 50
    assert tally.marks[Mark.RIGHT_REFUSAL] > 50


def test_no_transfer_is_wrong_on_invented_rigs(tmp_path: Path) -> None:
    tally = Tally()
    for seed in INVENTED:
        invented = invent(seed)
        tally.merge(compiled(invented.write(tmp_path), invented.lines, tmp_path))
    print(tally.report())  # noqa: T201 - the counts go into the record of a soak
    assert not tally.wrong, tally.report()
    assert tally.marks[Mark.RIGHT_PLAN] > 50
    assert tally.marks[Mark.RIGHT_REFUSAL] > 50


@needs_graphs
@pytest.mark.parametrize(
    ("name", "source", "target", "named"),
    [
        ("duplicate_node_names", "node1", "node1", "node1"),
        ("pump_then_valves_bad_ports", "flask_nitrogen", "filter", "valve2"),
        ("three_valve_connect_bad_ports", "flask_nitrogen", "filter", "valve"),
    ],
)
def test_a_graph_with_a_fault_is_refused_by_name(
    name: str, source: str, target: str, named: str, tmp_path: Path
) -> None:
    path = RIGS / f"chempiler_graphs/{name}.json"
    line: Line = {"from": source, "to": target, "volume": "1 mL"}
    answers = ask_compiler(path, [line], tmp_path)
    tally = judge_all(read_rig(path), name, [line], answers)
    refusals = tally.marks[Mark.RIGHT_REFUSAL] + tally.marks[Mark.OPEN_REFUSAL]
    assert refusals == 1, tally.report()
    assert named in json.dumps(answers[0], ensure_ascii=False)
