"""A rig drawn by hand for the judge's own tests, and right plans on it.

                 S1 ── C                       H ── S2 ── P3 ── S3 ── I
                 3                                  (syringe in line)
A ── 1 V1 2 ── B      D ── 2 V2 3 ── E       F ── 1 PV 2 ── G    (syringe with its own valve)
     V1 8 ────────────── 1 V2 8 ──────────────────── 3 PV
     V1 c ── P1 (10 mL)     V2 c ── P2 (25 mL)          (PV: 5 mL, P3: 2 mL)
     V1 4 ~~ K (transport)  V2 4 ── gas               J ── 5 V1 (no pump needed: dead end)
     V1 6 ── N1, N1 ── 1 V3 2 ── L, V3 c alone: outer to outer
"""

from __future__ import annotations

from typing import Any

from tests.judge.reading import read_json
from tests.judge.request import Request
from tests.judge.rig import Rig
from tests.judge.witness import Plan, action, move, set_port

COMMON = "transferpump"


def _node(name: str, class_name: str, **config: object) -> dict[str, Any]:
    return {"id": name, "type": "device", "class": class_name, "config": config}


def _vessel(name: str) -> dict[str, Any]:
    return {"id": name, "type": "container", "class": None, "config": {"max_volume": 1000.0}}


def _link(a: str, pa: str, b: str, pb: str, medium: str = "fluid") -> dict[str, Any]:
    return {"source": a, "target": b, "type": medium, "port": {a: pa, b: pb}}


def document() -> dict[str, Any]:
    """Return the graph as a Uni-Lab-OS document."""
    valve, pump, solenoid = "virtual_multiway_valve", "virtual_transfer_pump", "solenoid_valve"
    nodes = [
        *(_vessel(name) for name in "ABCDEFGHIJL"),
        *(_node(name, valve, positions=8) for name in ("V1", "V2", "V3")),
        _node("P1", pump, max_volume=10.0),
        _node("P2", pump, max_volume=25.0),
        _node("P3", pump, max_volume=2.0),
        _node("PV", "syringe_pump_with_valve.runze.SY03B-T08", max_volume=5.0, positions=8),
        *(_node(name, solenoid) for name in ("S1", "S2", "S3")),
        _node("K", "virtual_centrifuge"),
        _node("gas", "virtual_gas_source"),
        _node("bus", "serial"),
    ]
    links = [
        _link("P1", COMMON, "V1", COMMON),
        _link("V1", "1", "A", "top"),
        _link("V1", "2", "B", "top"),
        _link("V1", "3", "S1", "in"),
        _link("S1", "out", "C", "top"),
        _link("V1", "4", "K", "centrifuge", "transport"),
        _link("V1", "5", "J", "top"),
        _link("V1", "6", "V3", "1"),
        _link("V3", "2", "L", "top"),
        _link("V1", "8", "V2", "1", "physical"),
        _link("P2", COMMON, "V2", COMMON),
        _link("V2", "2", "D", "top"),
        _link("E", "bottom", "V2", "3"),
        _link("gas", "outlet", "V2", "4"),
        _link("V2", "8", "PV", "3"),
        _link("PV", "1", "F", "top"),
        _link("PV", "2", "G", "top"),
        _link("P3", "a", "S2", "out"),
        _link("P3", "b", "S3", "in"),
        _link("S2", "in", "H", "top"),
        _link("S3", "out", "I", "top"),
        *(_link("bus", "rs485", name, "rs485", "communication") for name in ("P1", "P2", "PV")),
    ]
    return {"nodes": nodes, "links": links}


def bench() -> Rig:
    """Return the rig."""
    return read_json(document())


def a_to_b() -> tuple[Request, Plan]:
    """Return 15 mL through one valve, in two strokes."""
    plan: Plan = []
    for volume_ul in (10_000.0, 5_000.0):
        plan += [[set_port("V1", "1")], [move("P1", "aspirate", volume_ul)]]
        plan += [[set_port("V1", "2")], [move("P1", "dispense", volume_ul)]]
    return Request("A", "B", 15_000_000), plan


def a_to_d() -> tuple[Request, Plan]:
    """Return 10 mL from pump to pump."""
    return Request("A", "D", 10_000_000), [
        [set_port("V1", "1")],
        [move("P1", "aspirate", 10_000.0)],
        [set_port("V1", "8"), set_port("V2", "1")],
        [move("P1", "dispense", 10_000.0), move("P2", "aspirate", 10_000.0)],
        [action("", "wait", duration_s=3.0), set_port("V2", "2")],
        [move("P2", "dispense", 10_000.0)],
    ]


def c_to_b() -> tuple[Request, Plan]:
    """Return 0.1 mL through a solenoid."""
    return Request("C", "B", 100_000), [
        [action("S1", "open"), set_port("V1", "3")],
        [move("P1", "aspirate", 100.0)],
        [action("S1", "close")],
        [set_port("V1", "2")],
        [move("P1", "dispense", 100.0)],
    ]


def f_to_g() -> tuple[Request, Plan]:
    """Return 5 mL with a syringe that has its own valve."""
    return Request("F", "G", 5_000_000), [
        [set_port("PV", "1")],
        [move("PV", "aspirate", 5000.0)],
        [set_port("PV", "2")],
        [move("PV", "dispense", 5000.0)],
    ]


def h_to_i() -> tuple[Request, Plan]:
    """Return 2 mL with a syringe in line between two solenoids."""
    return Request("H", "I", 2_000_000), [
        [action("S2", "open")],
        [move("P3", "aspirate", 2000.0)],
        [action("S2", "close")],
        [action("S3", "open")],
        [move("P3", "dispense", 2000.0)],
    ]


def f_to_d() -> tuple[Request, Plan]:
    """Return 1 mL out of a syringe with its own valve, through another valve's pump."""
    return Request("F", "D", 1_000_000), [
        [set_port("PV", "1"), set_port("V2", "8")],
        [move("PV", "aspirate", 1000.0)],
        [set_port("PV", "3")],
        [move("PV", "dispense", 1000.0), move("P2", "aspirate", 1000.0)],
        [set_port("V2", "2")],
        [move("P2", "dispense", 1000.0)],
    ]


RIGHT = {"a_to_b": a_to_b, "a_to_d": a_to_d, "c_to_b": c_to_b, "f_to_g": f_to_g}
RIGHT |= {"h_to_i": h_to_i, "f_to_d": f_to_d}
