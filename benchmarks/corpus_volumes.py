"""How much of each reagent got into each vessel: by the record of a run, and by who ran it before.

Compared is what the chemistry asks for: rinses, priming and the cleaning of vessels are left out,
as is what goes into a waste. Amounts that no recipe states in figures (*all* of a vessel) are none
of a reagent, but of what is in that vessel.
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.corpus_pairs import Pair
from labweb.domain.graph.rig.rig_read import read_rig, unpacked

Nodes = Mapping[str, Mapping[str, Any]]
"""Key of a node of the rig → what its file says of it, with its `class`."""

Volumes = dict[tuple[str, str], float]
"""Reagent and vessel → mL."""

OWN_WORK = frozenset(
    {"PrimePumpForAdd", "CleanBackbone", "CleanVessel"}
    | {"AddFilterDeadVolume", "RemoveFilterDeadVolume"}
)
"""Steps of a recipe by which a rig keeps itself clean, or makes up for its own volumes."""

NO_REAGENT = frozenset({"", "none", "nitrogen", "argon", "air", "Ar", "N2"})
_UL_PER_ML, _NL_PER_ML = 1000, 1_000_000
_ROUNDING_ML = 0.01


@dataclass(frozen=True, slots=True)
class Compared:
    """What a run brought into its vessels beside what it should have."""

    by: str
    """`trace`: another program carried the recipe out on this graph; `recipe`: nobody has."""

    differences: list[dict[str, Any]] = field(default_factory=list)
    """`reagent`, `vessel`, `ml` and `expected_ml`; none: they are the same."""

    def to_json(self) -> dict[str, Any]:
        """Render what a line has of it."""
        return {"compared_with": self.by, "differences": self.differences}


def compare(
    plan: Mapping[str, Any], nodes: Nodes, trace: Mapping[str, Any] | None, moved: Volumes
) -> Compared:
    """Hold what a run moved against a trace; without one, against what the recipe says.

    Args:
        plan: As `docs/plan.md` says it, of the recipe on the rig.
        nodes: Of the rig.
        trace: What another program did of the recipe on that rig; None: nobody has.
        moved: What the run moved, with the cleaning of vessels.
    """
    cleaning = of_plan(plan, nodes, OWN_WORK)
    found = {key: ml - cleaning.get(key, 0.0) for key, ml in moved.items()}
    expected = of_plan(plan, nodes) if trace is None else of_trace(trace, nodes)
    differences = [
        {
            "reagent": reagent,
            "vessel": vessel,
            "ml": round(found.get((reagent, vessel), 0.0), 3),
            "expected_ml": round(expected.get((reagent, vessel), 0.0), 3),
        }
        for reagent, vessel in sorted(found.keys() | expected.keys())
        if abs(found.get((reagent, vessel), 0.0) - expected.get((reagent, vessel), 0.0))
        > _ROUNDING_ML
    ]
    return Compared("recipe" if trace is None else "trace", differences)


def of_trace(trace: Mapping[str, Any], nodes: Nodes) -> Volumes:
    """Return what another program brought where, by its own list of steps."""
    found: defaultdict[tuple[str, str], float] = defaultdict(float)

    def follow(step: Mapping[str, Any], times: int) -> None:
        given, parts = step["props"], step.get("substeps", [])
        if step["step"] in OWN_WORK:
            return
        if step["step"] == "CMove" and not parts:
            source, target = nodes[str(given["from_vessel"])], str(given["to_vessel"])
            reagent = source.get("chemical") or ""
            if reagent not in NO_REAGENT and not _is_waste(nodes, target):
                found[reagent, target] += times * given["volume"]
        if step["step"] == "WashSolid" and all(part["step"] != "Repeat" for part in parts):
            times *= int(given.get("repeat") or 1)
        for part in parts:
            follow(part, times)

    for step in trace["steps"]:
        follow(step, 1)
    return {key: round(volume, 6) for key, volume in found.items()}


def of_plan(
    plan: Mapping[str, Any], nodes: Nodes, operations: Collection[str] | None = None
) -> Volumes:
    """Return what a plan brings where, of some steps of the recipe; None: of the chemistry."""
    found: defaultdict[tuple[str, str], float] = defaultdict(float)
    for step in plan["steps"]:
        does, operation = step["does"], step["of"]["operation"]
        is_meant = operation not in OWN_WORK if operations is None else operation in operations
        if does["kind"] != "transfer" or "lot" not in does or not is_meant:
            continue
        reagent = nodes.get(does["from"], {}).get("chemical") or ""
        if reagent not in NO_REAGENT and not _is_waste(nodes, does["to"]):
            found[reagent, does["to"]] += does["volume_ul"] / _UL_PER_ML
    return {key: round(volume, 6) for key, volume in found.items()}


def of_events(
    events: Iterable[Mapping[str, Any]], keys: Mapping[str, str], nodes: Nodes
) -> Volumes:
    """Return what a run brought where, by its events in the order of the record.

    What goes through syringes is followed to the flask that it came from.

    Args:
        events: As the run's page has them, without those of rinses.
        keys: Resource → its key in the lab, which is that of the graph.
        nodes: Of the rig.
    """
    held: defaultdict[str, Counter[str]] = defaultdict(Counter)
    found: defaultdict[tuple[str, str], float] = defaultdict(float)
    for event in events:
        ends = {one["role"]: keys.get(one["id"], "") for one in event["subjects"]}
        if not event["amount_nl"] or not {"source", "target"} <= ends.keys():
            continue
        source, target, amount_nl = ends["source"], ends["target"], event["amount_nl"]
        parts = Counter({source: amount_nl})
        if _is_pump(nodes.get(source)):
            parts = _drawn(held[source], amount_nl)
        if _is_pump(nodes.get(target)):
            held[target] += parts
            continue
        for flask, part_nl in parts.items():
            reagent = nodes.get(flask, {}).get("chemical") or ""
            if reagent not in NO_REAGENT and not _is_waste(nodes, target):
                found[reagent, target] += part_nl / _NL_PER_ML
    return {key: round(volume, 6) for key, volume in found.items()}


def _is_waste(nodes: Nodes, key: str) -> bool:
    return nodes.get(key, {}).get("class") == "ChemputerWaste"


def _is_pump(node: Mapping[str, Any] | None) -> bool:
    return node is not None and "pump" in str(node.get("class")).lower()


def _drawn(held: Counter[str], amount_nl: int) -> Counter[str]:
    """Take an amount out of a syringe, of each flask in proportion."""
    all_nl = held.total()
    if not all_nl:
        return Counter()
    part = Counter({flask: round(nl * amount_nl / all_nl) for flask, nl in held.items()})
    held -= part
    return part


def nodes_of(pair: Pair) -> Nodes:
    """Return the nodes of a rig, each with what its file says of it."""
    rig = read_rig(unpacked(pair.rig.read_bytes()))
    return {one.key: {**one.attributes, "class": one.kind} for one in rig.elements}


def read_trace(path: Path) -> dict[str, Any]:
    """Return what another program did of a recipe."""
    found: dict[str, Any] = json.loads(unpacked(path.read_bytes()))
    return found
