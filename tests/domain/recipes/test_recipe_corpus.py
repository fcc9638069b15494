"""Published recipes on published rigs, beside what their own software made of them.

Compared are the volumes of each reagent that reach each vessel. What the reference adds of its
own (priming, cleaning, filling the dead volume of a filter) is left out on its side. It looks
neither at room nor at the range of most thermostats; a rig that is *widened* has vessels and
thermostats that are large enough, so that the amounts can be compared all the same.
"""

from __future__ import annotations

import csv
import gzip
import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from benchmarks.corpus_volumes import Volumes, of_plan, of_trace
from labweb.domain.errors import LabError
from labweb.domain.recipes.recipe_to_plan import CompileWish
from tests.corpus import NO_XDL, XDL
from tests.domain.recipes.plans import check_claims, check_strokes, compiled

pytestmark = pytest.mark.skipif(not XDL.exists(), reason=NO_XDL)

DOCS = Path(__file__).parents[3] / "docs/xdl.md"
HOLDS = {
    "separate_no_buffers": {"filter": 20},
    "separate_more_than_max_volume": {"filter": 20},
}
"""Millilitres that a vessel of a unit recipe has to hold before, for nothing is put into it."""

NATIVE = (
    "antiviral_Arbidol_step1",
    "antiviral_Arbidol_step2",
    "antiviral_Arbidol_step3",
    "antiviral_Arbidol_step4",
    "antiviral_Arbidol_step5",
    "antiviral_Arbidol_step6",
    "antiviral_Arbidol_step7",
    "antiviral_Chloroquine_v4",
    "DMP",
    "lidocaine",
    "orgsyn_v80p0129",
    "orgsyn_v81p0262",
    "orgsyn_v83p0184a",
    "orgsyn_v83p0193",
    "orgsyn_v87p0016",
    "orgsyn_v88p0152_a",
    "orgsyn_v90p0251",
)


def loaded(path: Path) -> dict[str, Any]:
    raw = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    found: dict[str, Any] = json.loads(raw)
    return found


def recipe_file(name: str) -> Path:
    short = name.removeprefix("antiviral_")
    found = [XDL / f"recipes_0.3/{name}.xdl", *sorted((XDL / "antiviral").rglob(f"{short}.xdl"))]
    return next(path for path in found if path.exists())


def widened(graph: dict[str, Any]) -> dict[str, Any]:
    nodes = []
    for node in graph["nodes"]:
        larger = dict(node)
        if "pump" not in str(node.get("class")).lower():
            larger |= {k: 100_000 for k in ("max_volume", "collection_flask_volume") if k in node}
            larger |= {"min_temp": -100, "max_temp": 400}
        nodes.append(larger)
    return {**graph, "nodes": nodes}


def reference_volumes(run: dict[str, Any], graph: dict[str, Any]) -> Volumes:
    return of_trace(run, {node["id"]: node for node in graph["nodes"]})


def own_volumes(plan: dict[str, Any], graph: dict[str, Any]) -> Volumes:
    return of_plan(plan, {node["id"]: node for node in graph["nodes"]})


def codes(raw: bytes, graph: dict[str, Any], wish: CompileWish | None = None) -> list[str]:
    try:
        compiled(raw, graph, wish)
    except LabError as error:
        return sorted({finding.code for finding in error.findings})
    return []


def judged(run: dict[str, Any], raw: bytes, graph: dict[str, Any], wish: CompileWish) -> str:
    """Compile on the rig as published, then widened; compare what reaches the vessels."""
    why = codes(raw, graph, wish)
    wide = widened(graph)
    still = codes(raw, wide, wish) if why else []
    told = ", ".join(f"`{code}`" for code in why) or "plan"
    if still:
        return f"{told} | {', '.join(f'`{code}`' for code in still)} | "
    used = wide if why else graph
    plan = compiled(raw, used, wish)
    check_claims(plan)
    assert check_strokes(plan, used) > 0 or not any(own_volumes(plan, graph))
    widely = "plan" if why else ""
    if not run["compiled"]:
        return f"{told} | {widely} | not compiled by the reference"
    reference, own = reference_volumes(run, graph), own_volumes(plan, graph)
    same = sum(own.get(key) == volume for key, volume in reference.items())
    assert own == reference, {k: (reference.get(k), own.get(k)) for k in reference | own}
    return f"{told} | {widely} | all {same} equal"


@cache
def native_row(name: str) -> str:
    run = loaded(XDL / f"oracle_native/{name}.json.gz")
    graph = loaded(XDL.parent / run["graph"])
    return f"| `{name}` | {judged(run, recipe_file(name).read_bytes(), graph, CompileWish())} |"


def unit_wish(name: str) -> CompileWish:
    return CompileWish(holds_nl={k: {"mixture": v * 10**6} for k, v in HOLDS.get(name, {}).items()})


@cache
def unit_row(name: str) -> str:
    run = loaded(XDL / f"oracle_unit/{name}.json.gz")
    graph = loaded(XDL / "unit_0.3" / run["graph"])
    raw = (XDL / "unit_0.3" / run["recipe"]).read_bytes()
    return f"| `{name}` | {judged(run, raw, graph, unit_wish(name))} |"


@cache
def cross_row(name: str) -> str:
    run = loaded(XDL / f"cross_rig/{name}.oracle.json.gz")
    graph = loaded(XDL / "cross_rig" / run["graph"])
    raw = recipe_file(run["recipe"]).read_bytes()
    return f"| `{name.replace('__ON__', '` on `')}` | {judged(run, raw, graph, CompileWish())} |"


UNITS = sorted(p.name.removesuffix(".json.gz") for p in (XDL / "oracle_unit").glob("*.gz"))
PAIRS = sorted(p.name.removesuffix(".oracle.json.gz") for p in (XDL / "cross_rig").glob("*.gz"))


@pytest.mark.parametrize("name", NATIVE)
def test_a_recipe_on_its_own_rig_is_as_the_docs_say(name: str) -> None:
    assert native_row(name) in DOCS.read_text("utf-8"), native_row(name)


@pytest.mark.parametrize("name", UNITS)
def test_a_recipe_of_one_feature_is_as_the_docs_say(name: str) -> None:
    assert unit_row(name) in DOCS.read_text("utf-8"), unit_row(name)


@pytest.mark.parametrize("name", PAIRS)
def test_a_recipe_on_another_rig_is_as_the_docs_say(name: str) -> None:
    assert cross_row(name) in DOCS.read_text("utf-8"), cross_row(name)


BAD = "check_graph_spec_"
RIGS = {"TEMPLATE_std6": "unit_0.3/chemputer_std6.json"}
MISSING = {
    "Couldn't find filter in graph.": "filter",
    "Couldn't find reactor in graph.": "reactor",
    "Couldn't find separator in graph.": "separator",
    "Couldn't find rotavap in graph.": "rotavap",
}


def rig_file(name: str) -> Path | None:
    short = name.removeprefix("antiviral_")
    found = [
        XDL / RIGS.get(name, f"recipes_0.3/{name}_graph.json"),
        *(p.parent / "graph.json" for p in (XDL / "antiviral").rglob(f"{short}.xdl")),
    ]
    return next((path for path in found if path.exists()), None)


def test_what_a_rig_lacks_by_the_reference_it_lacks_here() -> None:
    """Of each pair that the reference cannot plumb for want of a vessel, when the rig is here."""
    count = 0
    with (XDL / "cross_rig/matrix.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["rig_can_be_plumbed"] == "False"]
    for row in rows:
        wanted = {kind for text, kind in MISSING.items() if text in row["reason"]}
        path = rig_file(row["rig"])
        if not wanted or path is None:
            continue
        with pytest.raises(LabError) as caught:
            compiled(recipe_file(row["recipe"]).read_bytes(), loaded(path))
        told = [f.message for f in caught.value.findings if f.code == "plan.no_vessel"]
        codes_ = {f.code for f in caught.value.findings}
        if any(code.startswith("xdl.") for code in codes_):
            continue
        for kind in wanted:
            assert any(f"no {kind}" in text for text in told), (row["recipe"], row["rig"], kind)
        count += 1
    assert count > 50


@pytest.mark.parametrize(
    ("name", "graph", "code"),
    [
        ("heater_chiller_reactor.xdl", "bigrig.json", "plan.out_of_range"),
        ("orgsyn_v83p0193.xdl", "bigrig.json", "plan.no_cartridge"),
        ("purge.xdl", "bigrig_no_backbone_inert_gas.json", ""),
        ("dry_in_reactor.xdl", "bigrig_no_vacuum_device.json", ""),
        ("evacuate.xdl", "pneumatic_controller.json", ""),
        ("orgsyn_v83p0193.xdl", f"{BAD}missing_component_type.json", "plan.no_vessel"),
        ("orgsyn_v83p0193.xdl", f"{BAD}missing_heater.json", "plan.no_thermostat"),
        ("orgsyn_v83p0193.xdl", f"{BAD}not_enough_spare_ports.json", "plan.no_reagent"),
        ("orgsyn_v83p0193_high_temp.xdl", f"{BAD}cannot_reach_temp.json", "plan.out_of_range"),
        ("add_all_volumes.xdl", f"{BAD}bad_valve_port.json", "graph.bad_port"),
        ("add_all_volumes.xdl", f"{BAD}bad_reactor_port.json", "graph.bad_port"),
    ],
)
def test_a_rig_that_lacks_something_is_refused_for_it(name: str, graph: str, code: str) -> None:
    found = codes((XDL / "unit_0.3" / name).read_bytes(), loaded(XDL / "unit_0.3" / graph))
    assert (code in found) if code else not found, found


@pytest.mark.parametrize("folder", ["negative/clairify", "negative/syntax_2019"])
def test_what_no_reader_takes_no_rig_gets(folder: str) -> None:
    graph = loaded(XDL / "unit_0.3/bigrig.json")
    for path in sorted((XDL / folder).glob("*.x*")):
        if "_pos" not in path.name:
            assert codes(path.read_bytes(), graph), path.name
