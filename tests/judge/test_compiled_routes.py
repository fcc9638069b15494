"""The compiler beside the Chemputer's router: the same way, or one that is no worse."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from tests.corpus import NO_GRAPHS
from tests.judge.corpora import RIGS
from tests.judge.harness import ask_compiler
from tests.judge.oracle import Oracle
from tests.judge.reading import read_rig
from tests.judge.request import parse_request
from tests.judge.rig import Kind, Rig
from tests.judge.routing import (
    Published,
    PublishedPath,
    cost_of,
    read_paths,
    read_published,
    tubes_of,
)
from tests.judge.verdict import Mark, judge

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
    pytest.mark.skipif(not RIGS.is_dir(), reason=NO_GRAPHS),
]


def pipelines() -> list[Published]:
    """List the published moves that a transfer can ask for: no nodes to pass."""
    path = RIGS / "routing/pipelining_expected.json"
    return [case for case in read_published(path) if not case.through] if path.exists() else []


def paths() -> list[PublishedPath]:
    """List the published paths that a transfer can ask for."""
    path = RIGS / "routing/pathfinding_expected.json"
    return [case for case in read_paths(path) if not case.through] if path.exists() else []


@cache
def all_answers(graph: Path) -> dict[str, object]:
    """Let the compiler answer every published case of a graph at once, by the case's line."""
    cases: list[Published | PublishedPath] = [*pipelines(), *paths()]
    lines = [dict(case.line) for case in cases if graph_of(case) == graph]
    with TemporaryDirectory() as scratch:
        answers = ask_compiler(graph, lines, Path(scratch))
    return {repr(line): answer for line, answer in zip(lines, answers, strict=True)}


def graph_of(case: Published | PublishedPath) -> Path:
    """Return the file of the graph that a case is about."""
    if isinstance(case, Published):
        return RIGS / case.graph
    graph = RIGS / "chempiler_graphs" / case.graph
    return graph if graph.exists() else graph.with_name(graph.name + ".gz")


def answered(case: Published | PublishedPath) -> tuple[Rig, Mapping[str, object]]:
    """Return the rig and an answer that the judge finds right."""
    graph, line = graph_of(case), dict(case.line)
    rig = read_rig(graph)
    answer = all_answers(graph)[repr(line)]
    verdict = judge(Oracle(rig), line, answer)
    assert verdict.mark is not Mark.WRONG, verdict
    assert isinstance(answer, Mapping)
    return rig, answer


@pytest.mark.parametrize("case", pipelines(), ids=lambda case: case.name)
def test_a_move_is_pipelined_at_least_as_well(case: Published) -> None:
    rig, answer = answered(case)
    ends_in_vessel = rig.devices[parse_request(case.line).target].kind is Kind.VESSEL
    if case.plan is None or not ends_in_vessel:
        assert answer["ok"] is False
    else:
        assert answer["ok"] is True
        ours, theirs = cost_of(rig, answer["steps"]), cost_of(rig, case.plan)
        assert ours.is_no_worse_than(theirs), f"{ours} against {theirs}"


@pytest.mark.parametrize("case", paths(), ids=lambda case: f"{case.graph} {case.line['from']}")
def test_a_path_is_the_published_one_or_shorter(case: PublishedPath) -> None:
    rig, answer = answered(case)
    if case.edges is None:
        assert answer["ok"] is False
    else:
        assert answer["ok"] is True
        tubes = tubes_of(rig, answer["steps"])
        assert tubes == case.edges or len(tubes) <= len(case.edges)
