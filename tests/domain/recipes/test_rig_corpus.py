"""Published rigs, with the paths and pipelined moves that their own software makes on them."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from benchmarks.transfers import counts
from labweb.domain.errors import LabFileError
from labweb.domain.graph.elements import ElementRole
from labweb.domain.graph.rig.rig_model import Rig, RigFormat
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.graph.rig.rig_write import write_rig
from labweb.domain.graph.syringe_chain import WantedChain, find_chain
from labweb.domain.recipes.transfers_on_rig import compile_line
from tests.corpus import GRAPHS, NO_GRAPHS, NO_XDL, XDL
from tests.domain.recipes.interpreter import Plumbing, check

pytestmark = pytest.mark.skipif(not XDL.is_dir(), reason=NO_XDL)

SETS = {
    "AF_RBF_TESTS": "AF-4-Tr-RBF.graphml",
    "ALKYL_FLUOR_GRAPH_TESTS": "AlkylFluor_full.graphml",
    "DISCOVERY_PIPELINE_TESTS": "discovery_graph.json",
    "DMP_TEST_GRAPH_TESTS": "DMP_graph_test.json",
    "ORGSYN_V83P0193_PIPELINE_TESTS": "orgsyn_v83p0193_graph.json",
}
RATES = {
    "speed": "rate",
    "initial_pump_speed": "draw_rate",
    "mid_pump_speed": "rate",
    "end_pump_speed": "push_rate",
}
OLD_RIGS = ("rig_2", "rig_3")
"""Rigs of 2018, whose links name one port: the interpreter of the tests does not read them."""


@cache
def rig(name: str) -> Rig:
    found = [
        path
        for folder in ("chempiler_graphs", "unit_0.3")
        for path in (XDL / folder / name, XDL / folder / f"{name}.gz")
        if path.is_file()
    ]
    return read_rig(unpacked(found[0]))


def unpacked(path: Path) -> bytes:
    raw = path.read_bytes()
    return gzip.decompress(raw) if path.suffix == ".gz" else raw


def cases(name: str) -> list[Any]:
    path = XDL / "routing" / name
    if not path.is_file():
        return []
    value = json.loads(path.read_bytes())
    if isinstance(value, list):
        return value
    return [(SETS[each], case) for each, found in value.items() for case in found]


def edges(path: list[Any]) -> list[tuple[str, str, str, str]]:
    flat = [e for leg in path for e in leg] if isinstance(path[0][0], list) else path
    return [(one, two, str(a), str(b)) for one, two, (a, b) in flat]


@pytest.mark.parametrize("case", cases("pathfinding_expected.json"))
def test_a_path_is_the_published_one_or_there_is_none(case: dict[str, Any]) -> None:
    network = rig(case["graph"]).network
    elements = network.elements
    wanted = WantedChain(
        source=network.index[case["src"]],
        target=network.index[case["dest"]],
        source_port=str(case["src_port"]),
        target_port=str(case["dest_port"]),
        through=tuple(network.index[key] for key in case["through"]),
    )
    chain = find_chain(network, wanted)
    if case["expected_path"] is None:
        assert chain is None
        return
    assert chain is not None
    expected = edges(case["expected_path"])
    got = [
        (elements[one[0]].key, elements[two[0]].key, one[1], two[1])
        for hop in chain.hops
        for one, two in zip(hop.ports[::2], hop.ports[1::2], strict=True)
    ]
    if not any(two.startswith("pump") for _, two, _, _ in expected):
        # The published path names the valves alone; ours names the syringes on them too.
        got = [e for e in got if not e[0].startswith("pump") and not e[1].startswith("pump")]
    assert got == expected


def request_of(move: dict[str, Any]) -> dict[str, Any]:
    asked = {"from": move["src"], "to": move["dest"], "volume": f"{move['volume']} mL"}
    for name, ours in (("src_port", "from_port"), ("dest_port", "to_port")):
        if name in move:
            asked[ours] = str(move[name])
    through = move.get("through_nodes") or []
    if through:
        asked["through"] = through if isinstance(through, list) else [through]
    asked |= {ours: f"{move[name]} mL/min" for name, ours in RATES.items() if move.get(name)}
    return asked


def moves_of_ours(steps: list[list[dict[str, Any]]]) -> list[dict[str, tuple[Any, ...]]]:
    return [
        {
            c["device"]: (
                ("set", c["parameters"]["port"])
                if c["action"] == "set_port"
                else (
                    c["action"],
                    c["parameters"]["volume_ul"] / 1000,
                    round(c["parameters"]["rate_ul_s"] * 0.06, 3),
                )
            )
            for c in group
        }
        for group in steps
    ]


def moves_of_theirs(groups: list[Any]) -> list[dict[str, tuple[Any, ...]]]:
    names = {"sink": "aspirate", "source": "dispense"}
    return [
        {
            device: (
                ("set", str(command["cmd"][1] if command["cmd"][1] != -1 else command["cmd"][2]))
                if command["cmd"][0] == "route"
                else (names[command["cmd"][0]], command["volume"], command["speed"])
            )
            for device, command in group
        }
        for group in groups
    ]


def duration_s(moves: list[dict[str, tuple[Any, ...]]]) -> float:
    """Return how long the plungers move: the slowest of each group, one group after another."""
    return sum(
        max((60 * told[1] / told[2] for told in group.values() if told[0] != "set"), default=0.0)
        for group in moves
    )


REFUSED = {
    # The syringe would stay full: every plan ends with empty syringes. Twice as much as it
    # holds is an error of the published software too.
    ("phase_B", "pump_Y", 25): "plan.not_a_vessel",
    ("phase_B", "pump_Y", 50): "plan.not_a_vessel",
    # Nothing leads to that port: an error of the published software too.
    ("reactor", "separator", 50): "plan.unknown_port",
    # A separator is no part of a way: two transfers do it, which the next test shows.
    ("flask_oxone_aq", "rotavap", 15): "plan.no_conductor",
}


@pytest.mark.parametrize(("graph", "case"), cases("pipelining_expected.json"))
def test_a_pipelined_move_is_the_published_one_or_provably_no_worse(
    graph: str, case: dict[str, Any]
) -> None:
    move = case["move"]
    answer = compile_line(rig(graph), json.dumps(request_of(move)).encode())
    if not answer["ok"]:
        code = answer["findings"][0]["code"]
        assert REFUSED[move["src"], move["dest"], move["volume"]] == code
        assert (
            case["groups"] == "err"
            or move["dest"] == "pump_Y"
            or "flask_separator" in move["through_nodes"]
        )
        return
    ours, theirs = moves_of_ours(answer["steps"]), moves_of_theirs(case["groups"])
    if ours == theirs:
        return
    # No more groups, no more commands, no more time, the same valves to the same ports in the
    # same order; strokes of equal size take the place of a full one and the rest.
    assert len(ours) <= len(theirs)
    assert sum(map(len, ours)) <= sum(map(len, theirs))
    assert duration_s(ours) <= duration_s(theirs) + 1e-3
    for our, their in zip(ours, theirs, strict=True):
        turned = {key: told for key, told in our.items() if told[0] == "set"}
        assert turned.items() <= their.items()
        assert {k: t[0] for k, t in our.items() if k not in turned} == {
            k: t[0] for k, t in their.items() if t[0] != "set"
        }


def test_what_the_published_software_leads_through_a_separator_is_two_transfers() -> None:
    (case,) = [
        each
        for graph, each in cases("pipelining_expected.json")
        if "flask_separator" in (each["move"].get("through_nodes") or ())
    ]
    asked = request_of(case["move"])
    rates = {name: asked[name] for name in ("rate", "draw_rate", "push_rate")}
    first = {"from": asked["from"], "to": "flask_separator", "volume": "15 mL", **rates}
    then = {"from": "flask_separator", "to": asked["to"], "volume": "15 mL", **rates}
    ours = []
    for each in (first, then | {"through": ["cartridge_drying"]}):
        answer = compile_line(rig("DMP_graph_test.json"), json.dumps(each).encode())
        assert answer["ok"], answer
        ours += moves_of_ours(answer["steps"])
    theirs = moves_of_theirs(case["groups"])
    assert len(ours) <= len(theirs)
    assert duration_s(ours) <= duration_s(theirs) + 1e-3


def graphs() -> Iterator[tuple[Path, Rig]]:
    found = [*GRAPHS.rglob("*.json"), *XDL.rglob("*.json"), *XDL.rglob("*.graphml*")]
    for path in sorted(found):
        if any(word in path.name for word in ("oracle", *OLD_RIGS)):
            continue
        try:
            yield path, read_rig(unpacked(path))
        except LabFileError:
            continue


@pytest.mark.skipif(not GRAPHS.is_dir(), reason=NO_GRAPHS)
def test_the_page_has_the_counts_that_the_benchmark_finds() -> None:
    page = (Path(__file__).parents[3] / "docs/routing.md").read_text()
    found = counts(GRAPHS)
    refused = {code: number for code, number in found.items() if code.startswith("plan.")}
    rows = {
        "graphs with liquid links": found["graphs"],
        "requests": found["ok"] + sum(refused.values()),
        "compiled": found["ok"],
        "refused": sum(refused.values()),
        **{f"… `{code}`": number for code, number in refused.items()},
    }
    for name, number in rows.items():
        assert f"\n| {name} | {number} |" in page, name


def test_plans_on_every_published_rig_move_the_amount_and_nothing_else() -> None:
    # Every seventh pair of vessels; `python -m benchmarks.transfers` counts them all.
    feasible = refused = 0
    for path, found in graphs():
        value = json.loads(write_rig(found, RigFormat.NODE_LINK))
        if not any(tube.medium.value == "liquid" for tube in found.tubes):
            continue
        plumbing = Plumbing(value)
        vessels = [e.key for e in found.network.elements if e.role is ElementRole.VESSEL]
        pairs = [(a, b) for a in vessels for b in vessels if a != b]
        for place, (source, target) in enumerate(pairs[::7]):
            ml = (0.1, 10, 60)[place % 3]
            request = {"from": source, "to": target, "volume": f"{ml} mL"}
            answer = compile_line(found, json.dumps(request).encode())
            if answer["ok"]:
                feasible += 1
                check(plumbing, answer["steps"], source, target, ml * 1000)
            else:
                refused += 1
                assert answer["findings"][0]["message"], path
    assert feasible > 1500
    assert refused > 2500
