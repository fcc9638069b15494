"""Small rigs and plans, written by hand from the page about plans.

flask_water ──0┐                    ┌0── reactor (hotplate, stirrer, lamp, thermometer)
flask_ether ──1┤                    ├1── filter bottom (chiller, stirrer)
flask_n2   ───2┼ valve_1 ═3═4═ valve_2 ─2── waste
solenoid ───5┘   │           │    ├3── separator bottom (conductivity sensor, stirrer)
                pump_1      pump_2  └5── rotavap evaporate
reactor 1 ── valve_vac -1;  valve_vac 0 ── line (pump cvc);  1 ── flask_n2;  5 free
flask_d, flask_e ── cvc_d ── line_d ── valve_d 0;  valve_d -1 ── flask_f
flask_g ── valve_g -1;  valve_g 0 ── line_g, which is always on;  5 free
"""

from __future__ import annotations

import copy
import hashlib
import json
from typing import Any

from labweb.domain.errors import Finding
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.proof.execute_plan import check_plan, execute
from labweb.domain.proof.plan_read import parse_plan
from labweb.domain.proof.plan_state import State

CLASSES = {
    "valve_1": "ChemputerValve",
    "valve_2": "ChemputerValve",
    "valve_3": "ChemputerValve",
    "valve_vac": "ChemputerValve",
    "pump_3": "ChemputerPump",
    "solenoid": "virtual_solenoid_valve",
    "flask_a": "ChemputerFlask",
    "flask_b": "ChemputerFlask",
    "flask_c": "ChemputerFlask",
    "line_b": "ChemputerVacuum",
    "flask_d": "ChemputerFlask",
    "flask_e": "ChemputerFlask",
    "flask_f": "ChemputerFlask",
    "line_d": "ChemputerVacuum",
    "flask_g": "ChemputerFlask",
    "line_g": "ChemputerVacuum",
    "valve_g": "ChemputerValve",
    "valve_d": "ChemputerValve",
    "cvc_d": "CVC3000",
    "pump_1": "ChemputerPump",
    "pump_2": "ChemputerPump",
    "flask_water": "ChemputerFlask",
    "flask_ether": "ChemputerFlask",
    "flask_n2": "ChemputerFlask",
    "flask_empty": "ChemputerFlask",
    "reactor": "ChemputerReactor",
    "filter": "ChemputerFilter",
    "separator": "ChemputerSeparator",
    "waste": "ChemputerWaste",
    "cartridge": "ChemputerCartridge",
    "line": "ChemputerVacuum",
    "cvc": "CVC3000",
    "rotavap": "IKARV10",
    "hotplate": "IKARCTDigital",
    "stirrer": "HeiTORQUE_100",
    "stirrer_s": "HeiTORQUE_100",
    "chiller": "JULABOCF41",
    "lamp": "PhotoLamp",
    "thermometer": "TemperatureSensor",
    "sensor": "ConductivitySensor",
    "cvc_rotavap": "CVC3000",
}
TUBES = (
    "flask_water:0 valve_1:0",
    "flask_ether:0 valve_1:1",
    "flask_n2:0 valve_1:2",
    "flask_empty:0 solenoid:in",
    "solenoid:out valve_1:5",
    "pump_3:0 valve_3:-1",
    "flask_a:0 valve_3:0",
    "flask_b:0 valve_3:0",
    "line_b:0 valve_3:1",
    "flask_c:0 valve_3:2",
    "valve_3:3 > cartridge:in",
    "reactor:2 valve_3:4",
    "rotavap:collect valve_3:5",
    "valve_1:3 valve_2:4",
    "pump_1:0 valve_1:-1",
    "pump_2:0 valve_2:-1",
    "reactor:0 valve_2:0",
    "filter:bottom valve_2:1",
    "waste:0 valve_2:2",
    "separator:bottom valve_2:3",
    "rotavap:evaporate valve_2:5",
    "reactor:1 valve_vac:-1",
    "line:0 valve_vac:0",
    "flask_n2:0 valve_vac:1",
    "valve_1:4 > cartridge:in",
    "cartridge:out filter:top",
    "flask_f:0 valve_d:-1",
    "line_d:0 valve_d:0",
    "flask_g:0 valve_g:-1",
    "line_g:0 valve_g:0",
)
LINKS = (
    "cvc line",
    "cvc_rotavap rotavap",
    "cvc_d flask_d",
    "cvc_d flask_e",
    "cvc_d line_d",
    "hotplate reactor",
    "stirrer filter",
    "stirrer_s separator",
    "chiller filter",
    "lamp reactor",
    "thermometer reactor",
    "sensor separator",
)
VOLUMES = {"reactor": 100, "filter": 100, "separator": 100, "waste": 2000, "rotavap": 100}


def graph() -> dict[str, Any]:
    nodes: list[dict[str, Any]] = [{"id": key, "class": name} for key, name in CLASSES.items()]
    for node in nodes:
        if node["id"] in ("pump_1", "pump_2"):
            node["max_volume"] = 10
        elif node["id"] in VOLUMES:
            node["max_volume"] = VOLUMES[node["id"]]
        if node["id"] == "flask_n2":
            node["chemical"] = "nitrogen"
        if node["id"] == "rotavap":
            node["collection_flask_volume"] = 50
    links: list[dict[str, Any]] = []
    for text in TUBES:
        (one, a), (two, b) = (end.split(":") for end in text.replace(">", "").split())
        ways = ((one, a, two, b), (two, b, one, a))
        for source, out, target, into in ways[:1] if ">" in text else ways:
            links.append({"source": source, "target": target, "port": f"({out},{into})"})
    for text in LINKS:
        source, target = text.split()
        links.append({"source": source, "target": target, "port": "(,)"})
    for place, link in enumerate(links):
        link["id"] = place
    return {"nodes": nodes, "links": links}


GRAPH = json.dumps(graph()).encode()
RIG = read_rig(GRAPH)
SHA = hashlib.sha256(GRAPH).hexdigest()


def act(text: str, /, **parameters: object) -> dict[str, Any]:
    """`"pump_1 aspirate"` and its parameters."""
    device, action = text.split()
    return {"device": device, "action": action, "parameters": parameters}


def port(valve: str, name: str) -> dict[str, Any]:
    return act(f"{valve} set_port", port=name)


def draw(pump: str, volume_ul: float, **more: object) -> dict[str, Any]:
    return act(f"{pump} aspirate", volume_ul=volume_ul, rate_ul_s=500, **more)


def push(pump: str, volume_ul: float) -> dict[str, Any]:
    return act(f"{pump} dispense", volume_ul=volume_ul, rate_ul_s=500)


def carry(source: str, target: str, *strokes: float, **more: object) -> list[list[dict[str, Any]]]:
    """From a port of valve 1 to a port of valve 2, over both syringes."""
    groups = []
    for volume_ul in strokes:
        groups += [
            [port("valve_1", source)],
            [draw("pump_1", volume_ul, **more)],
            [port("valve_1", "3"), port("valve_2", "4")],
            [push("pump_1", volume_ul), draw("pump_2", volume_ul)],
            [port("valve_2", target)],
            [push("pump_2", volume_ul)],
        ]
    return groups


def shift(source: str, target: str, *strokes: float, **more: object) -> list[list[dict[str, Any]]]:
    """From one port of valve 2 to another."""
    groups = []
    for volume_ul in strokes:
        groups += [
            [port("valve_2", source)],
            [draw("pump_2", volume_ul, **more)],
            [port("valve_2", target)],
            [push("pump_2", volume_ul)],
        ]
    return groups


def by_hand(action: str, **parameters: object) -> dict[str, Any]:
    return act(f"@by_hand {action}", text="please", **parameters)


def step(kind: str, groups: list[list[dict[str, Any]]], /, **claim: object) -> dict[str, Any]:
    names = {name.rstrip("_"): value for name, value in claim.items()}
    return {"does": {"kind": kind, **names}, "actions": groups}


def plan(*steps: dict[str, Any], **contents: dict[str, float]) -> dict[str, Any]:
    """A plan of these steps; contents are lots in microlitres, or, after `solid_`, micrograms."""
    held = {
        key.replace("__", "#"): [
            {"lot": lot, "phase": "solid", "mass_ug": amount}
            if lot.startswith("solid_")
            else {"lot": lot, "phase": "liquid", "volume_ul": amount}
            for lot, amount in lots.items()
        ]
        for key, lots in contents.items()
    }
    return {
        "plan": 1,
        "recipe": {"id": "trial", "sha256": "0" * 64},
        "graph_sha256": SHA,
        "bindings": {"vessels": {}, "reagents": {}},
        "contents": held,
        "capacities_ul": {},
        "steps": [
            {
                "id": number,
                "of": {"operation": "Trial"},
                "does": copy.deepcopy(one["does"]),
                "actions": copy.deepcopy(one["actions"]),
                "after": list(range(1, number)),
                "estimate_s": 1.0,
            }
            for number, one in enumerate(steps, start=1)
        ],
        "totals": {},
        "notes": [],
    }


def check(wanted: dict[str, Any]) -> list[Finding]:
    return check_plan(RIG, parse_plan(json.dumps(wanted).encode()), SHA)


def run(wanted: dict[str, Any]) -> State:
    return execute(RIG, parse_plan(json.dumps(wanted).encode()), SHA)


def codes(wanted: dict[str, Any]) -> set[str]:
    return {finding.code for finding in check(wanted)}
