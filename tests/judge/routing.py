"""Published plans of the Chemputer's own router, as plans of ours, and how two plans compare.

A group of the router's is a set of commands given at once: `route (outer, -1)` turns a valve,
`sink` draws and `source` pushes, mL and mL/min. Groups become steps one by one.

A plan costs three numbers, all of which a better plan may only lower:

* moves: plunger strokes;
* time: the sum over steps of the longest stroke of the step, in mL, all syringes at one rate. The
  published speeds are parameters of the request there and no part of ours, so they are left out;
* tubes: how many different hoses liquid runs through, which stands for dead volume where the graph
  states none.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from tests.judge.actions import Move, Turn, parse_steps
from tests.judge.flow import Walk
from tests.judge.rig import Hose, Rig
from tests.judge.witness import Plan, move, set_port

_GRAPH_OF = {
    "AF_RBF_TESTS": "unit_0.3/AF-4-Tr-RBF.graphml",
    "ALKYL_FLUOR_GRAPH_TESTS": "chempiler_graphs/AlkylFluor_full.graphml.gz",
    "DISCOVERY_PIPELINE_TESTS": "chempiler_graphs/discovery_graph.json",
    "DMP_TEST_GRAPH_TESTS": "chempiler_graphs/DMP_graph_test.json",
    "ORGSYN_V83P0193_PIPELINE_TESTS": "chempiler_graphs/orgsyn_v83p0193_graph.json",
}


@dataclass(frozen=True)
class Cost:
    """What a plan takes."""

    moves: int
    time_ml: Fraction
    tubes: int

    def is_no_worse_than(self, other: Cost) -> bool:
        """Tell whether no number is higher."""
        return (
            self.moves <= other.moves
            and self.time_ml <= other.time_ml
            and self.tubes <= other.tubes
        )


@dataclass(frozen=True)
class Published:
    """One move of the router's tests."""

    name: str
    graph: str
    """The rig's file, below the folder of rigs."""
    line: Mapping[str, object]
    """The request as a line of ours."""
    plan: Plan | None
    """None: the router has to refuse."""
    through: tuple[str, ...]
    """Nodes that the move has to pass; a transfer of ours has no such wish."""


def read_published(path: Path) -> list[Published]:
    """Return all moves of the file of expected pipelines."""
    document = json.loads(path.read_text("utf-8"))
    return [
        _published(f"{family} {number}", case)
        for family, cases in document.items()
        for number, case in enumerate(cases)
    ]


def _published(name: str, case: Mapping[str, Any]) -> Published:
    wanted = case["move"]
    line = {"from": wanted["src"], "to": wanted["dest"], "volume": f"{wanted['volume']} mL"}
    for key, ours in (("src_port", "from_port"), ("dest_port", "to_port")):
        if wanted.get(key) is not None:
            line[ours] = str(wanted[key])
    through = wanted.get("through_nodes") or ()
    names = (through,) if isinstance(through, str) else tuple(through)
    groups = case["groups"]
    plan = [_step(group) for group in groups] if isinstance(groups, list) else None
    return Published(name, _GRAPH_OF[name.split()[0]], line, plan, names)


def _step(group: list[Any]) -> list[dict[str, Any]]:
    acts = []
    for device, order in group:
        command, *arguments = order["cmd"]
        if command == "route":
            outer = next(port for port in arguments if port != -1)
            acts.append(set_port(device, str(outer)))
        else:
            name = "aspirate" if command == "sink" else "dispense"
            rate_ul_s = order["speed"] * 1000 / 60
            acts.append(move(device, name, order["volume"] * 1000, rate_ul_s))
    return acts


def cost_of(rig: Rig, plan: object) -> Cost:
    """Return what a plan takes; the plan has to be one that plays."""
    moves, time_nl = 0, Fraction(0)
    for acts in parse_steps(rig, plan):
        volumes_nl = [act.volume_nl for act in acts if isinstance(act, Move)]
        moves += len(volumes_nl)
        time_nl += max(volumes_nl, default=Fraction(0))
    return Cost(moves, time_nl / 10**6, len(hoses_of(rig, plan)))


def hoses_of(rig: Rig, plan: object) -> frozenset[Hose]:
    """Return the hoses through which a plan sends liquid."""
    used: set[Hose] = set()
    positions: dict[str, str] = {}
    opened: set[str] = set()
    for acts in parse_steps(rig, plan):
        for act in acts:
            if isinstance(act, Turn) and act.port is not None:
                positions[act.device] = act.port
            elif isinstance(act, Turn):
                (opened.add if act.is_open else opened.discard)(act.device)
        for act in acts:
            if isinstance(act, Move):
                walk = Walk(rig, positions, opened, act.sense)
                walk.start(act.device)
                used |= walk.hoses
    return frozenset(used)


@dataclass(frozen=True)
class PublishedPath:
    """One path of the router's tests, or the want of one."""

    graph: str
    line: Mapping[str, object]
    edges: frozenset[frozenset[tuple[str, str]]] | None
    """Ends of each tube from vessel to vessel, those to pumps left out; None: no path."""
    through: tuple[str, ...]


def read_paths(path: Path) -> list[PublishedPath]:
    """Return all cases of the file of expected paths."""
    return [_path(case) for case in json.loads(path.read_text("utf-8"))]


def _path(case: Mapping[str, Any]) -> PublishedPath:
    line = {"from": case["src"], "to": case["dest"], "volume": "1 mL"}
    line |= {"from_port": str(case["src_port"]), "to_port": str(case["dest_port"])}
    expected = case["expected_path"]
    edges = None
    if expected is not None:
        halves = expected if isinstance(expected[0][0], list) else [expected]
        edges = frozenset(
            frozenset(((a, str(ports[0])), (b, str(ports[1]))))
            for half in halves
            for a, b, ports in half
            if not {a.split("_")[0], b.split("_")[0]} & {"pump"}
        )
    return PublishedPath(case["graph"], line, edges, tuple(case["through"]))


def tubes_of(rig: Rig, plan: object) -> frozenset[frozenset[tuple[str, str]]]:
    """Return the ends of each tube that a plan uses, those to pumps left out."""
    pumps = set(rig.pumps())
    return frozenset(
        frozenset((hose.a, hose.b))
        for hose in hoses_of(rig, plan)
        if not {hose.a[0], hose.b[0]} & pumps
    )


def recorded_plan(groups: list[list[list[Any]]]) -> Plan:
    """Return groups as the traces of whole recipes have them: `[device, command, …]`."""
    steps = []
    for group in groups:
        acts: list[Any] = []
        for device, command, *rest in group:
            order: dict[str, Any] = {"cmd": [command, *rest]}
            if command != "route":
                order |= {"volume": rest[1], "speed": rest[2]}
            acts.append([device, order])
        steps.append(_step(acts))
    return steps
