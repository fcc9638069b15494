"""Small rigs drawn in a few words, as Chemputer graphs."""

from __future__ import annotations

import json
from typing import Any

from labweb.domain.graph.rig.rig_model import Rig
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.transfers_on_rig import compile_line

CLASSES = {
    "valve": "ChemputerValve",
    "pump": "ChemputerPump",
    "flask": "ChemputerFlask",
    "waste": "ChemputerWaste",
    "reactor": "ChemputerReactor",
    "separator": "ChemputerSeparator",
    "filter": "ChemputerFilter",
    "cartridge": "ChemputerCartridge",
    "manifold": "ChemputerManifold",
    "vacuum": "ChemputerVacuum",
    "stirrer": "HeiTORQUE_100",
    "rotavap": "IKARV10",
}


def chemputer(*links: str, pump_ml: float = 25) -> dict[str, Any]:
    """Draw a graph: `"flask_a:0 > valve_1:3"` conducts one way, `=` instead of `>` both.

    The class of a node is the word before the first underscore of its name.
    """
    nodes: dict[str, dict[str, Any]] = {}
    drawn: list[dict[str, Any]] = []
    for text in links:
        sign = "=" if "=" in text else ">"
        ends = [end.strip().rpartition(":") for end in text.split(sign)]
        for name, _, _ in ends:
            nodes.setdefault(name, {"id": name, "class": CLASSES[name.partition("_")[0]]})
            if name.startswith("pump"):
                nodes[name]["max_volume"] = pump_ml
        (one, _, a), (two, _, b) = ends
        pairs = [(one, a, two, b)] + ([(two, b, one, a)] if sign == "=" else [])
        for source, out, target, into in pairs:
            link = {"id": len(drawn), "source": source, "target": target, "port": f"({out},{into})"}
            drawn.append(link)
    return {"nodes": list(nodes.values()), "links": drawn}


def rig_of(graph: dict[str, Any]) -> Rig:
    return read_rig(json.dumps(graph).encode())


def ask(
    graph: dict[str, Any], source: str, target: str, volume: str, **more: object
) -> dict[str, Any]:
    request = {"from": source, "to": target, "volume": volume, **more}
    return compile_line(rig_of(graph), json.dumps(request).encode())


def steps_of(
    graph: dict[str, Any], source: str, target: str, volume: str, **more: object
) -> list[list[dict[str, Any]]]:
    answer = ask(graph, source, target, volume, **more)
    assert answer["ok"], answer
    steps: list[list[dict[str, Any]]] = answer["steps"]
    return steps


def codes_of(
    graph: dict[str, Any], source: str, target: str, volume: str = "1 mL", **more: object
) -> list[str]:
    answer = ask(graph, source, target, volume, **more)
    assert not answer["ok"], answer
    return [finding["code"] for finding in answer["findings"]]


def told(steps: list[list[dict[str, Any]]]) -> list[list[str]]:
    """Return a plan in short: `"valve_1 3"`, `"pump_1 +1000"`, `"pump_1 -1000"`."""
    return [sorted(_short(command) for command in group) for group in steps]


def _short(command: dict[str, Any]) -> str:
    sign = {"aspirate": "+", "dispense": "-"}.get(command["action"])
    if sign is not None:
        return f"{command['device']} {sign}{command['parameters']['volume_ul']:g}"
    return f"{command['device']} {command['parameters'].get('port', command['action'])}"
