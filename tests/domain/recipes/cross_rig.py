"""Every recipe of the published cross-rig matrix on every rig of it that lies beside the project.

The reference took the flasks of reagents off a rig, plumbed it anew for the recipe, compiled and
ran. Here the same rig without them is given to the advice; what it draws is compiled and proved.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from benchmarks.corpus_volumes import NO_REAGENT
from labweb.domain.errors import LabError
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.advise.fewest_changes import Advice, advise
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.xdl.file_format.read_xdl import check_document
from labweb.domain.recipes.xdl.file_format.xml_tree import parse_markup
from tests.corpus import XDL
from tests.domain.recipes.plans import compiled
from tests.domain.recipes.test_recipe_corpus import (
    loaded,
    own_volumes,
    recipe_file,
    reference_volumes,
    rig_file,
    widened,
)

PLUMBING = frozenset({"add_flask", "swap_flask", "add_cartridge", "lay_tube"})
"""What the reference's own generator of graphs adds."""

LARGER = frozenset({"enlarge", "attach"})
"""What it does not ask for: room, and the range of most thermostats."""

Amounts = dict[tuple[str, str], float]


@dataclass(frozen=True)
class Judged:
    """What became of one recipe on one rig."""

    ours: str
    """`p` plumbed alone, `l` more room, reach or valves, `d` more devices, `x` refused."""

    why: tuple[str, ...] = ()
    """Codes of the refusal."""

    is_equal: bool | None = None
    """Each vessel got what it gets by the reference on the recipe's own rig; None: unknown."""


@cache
def matrix() -> Mapping[tuple[str, str], Mapping[str, str]]:
    """Return the rows of the matrix by recipe and rig."""
    with (XDL / "cross_rig/matrix.csv").open(encoding="utf-8") as file:
        return {(row["recipe"], row["rig"]): row for row in csv.DictReader(file)}


@cache
def pairs() -> tuple[tuple[str, str], ...]:
    """Return the pairs of which recipe and rig are both here."""
    return tuple(pair for pair in matrix() if rig_file(pair[1]) is not None)


def stripped(graph: dict[str, Any]) -> dict[str, Any]:
    """Take the flasks of reagents off a rig, and the cartridges."""
    gone = {
        str(node["id"])
        for node in graph["nodes"]
        if node.get("class") == "ChemputerFlask" and (node.get("chemical") or "") not in NO_REAGENT
    }
    nodes = [node for node in graph["nodes"] if str(node["id"]) not in gone]
    links = [n for n in graph["links"] if not {str(n["source"]), str(n["target"])} & gone]
    return {**graph, "nodes": nodes, "links": links}


@cache
def expected(recipe: str) -> Amounts | None:
    """Return what the reference brings to each vessel of the recipe, on the recipe's own rig."""
    run = loaded(XDL / f"oracle_native/{recipe}.json.gz")
    if not run["compiled"]:
        return None
    graph = loaded(XDL.parent / run["graph"])
    try:
        plan = compiled(recipe_file(recipe).read_bytes(), widened(graph))
    except LabError:
        return None
    return _by_name(reference_volumes(run, graph), plan)


def _by_name(volumes: Amounts, plan: Mapping[str, Any]) -> Amounts:
    names = {key: name for name, key in plan["bindings"]["vessels"].items()}
    found: Amounts = {}
    for (chemical, key), volume in volumes.items():
        place = (chemical, names.get(key, key))
        found[place] = found.get(place, 0.0) + volume
    return {key: round(volume, 6) for key, volume in found.items()}


@cache
def judged(recipe: str, rig_name: str) -> Judged:
    """Plumb a rig for a recipe, compile, prove, and compare what reaches the vessels."""
    path = rig_file(rig_name)
    assert path is not None
    rig = read_rig(json.dumps(stripped(loaded(path))).encode())
    raw = recipe_file(recipe).read_bytes()
    vessels = frozenset(Equipment(rig).vessels)
    read, findings = check_document(parse_markup(raw), rig_vessels=vessels)
    if findings:
        return Judged("x", tuple(sorted({finding.code for finding in findings})))
    advice = advise(read, rig)
    if not isinstance(advice, Advice):
        causes = {f.message.partition("cures ")[2].partition(":")[0] or f.code for f in advice}
        return Judged("x", tuple(sorted(causes)))
    kinds = {change["change"] for change in advice.changes}
    own = _by_name(own_volumes(advice.plan, json.loads(advice.graph)), advice.plan)
    wanted = expected(recipe)
    sort = "p" if kinds <= PLUMBING else "l" if kinds <= PLUMBING | LARGER | {"add_valve"} else "d"
    return Judged(sort, (), None if wanted is None else own == wanted)


def grid(rows: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Yield the table of the documentation: recipes down, rigs across."""
    known = list(rows)
    recipes, rigs = (sorted({pair[end] for pair in known}) for end in (0, 1))
    yield "| recipe | " + " | ".join(str(n) for n in range(1, len(rigs) + 1)) + " |"
    yield "|---" * (len(rigs) + 1) + "|"
    for recipe in recipes:
        cells = (_cell(recipe, rig) if (recipe, rig) in known else "" for rig in rigs)
        yield f"| `{recipe}` | " + " | ".join(cells) + " |"


def _cell(recipe: str, rig: str) -> str:
    ran = matrix()[recipe, rig]["executed"] == "True"
    return ("R" if ran else "–") + judged(recipe, rig).ours
