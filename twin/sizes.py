"""How large a resource is drawn: as the lab says, else by its volume, else by its kind."""

from __future__ import annotations

import math

from labweb.domain.resources.resource_kinds import is_vessel
from twin.frames import Vector
from twin.state import TwinResource

_BY_KIND: dict[str, Vector] = {
    "syringe_pump": (45.0, 115.0, 128.0),
    "rotary_valve": (45.0, 45.0, 45.0),
    "solenoid_valve": (30.0, 40.0, 40.0),
    "heater_stirrer": (160.0, 270.0, 85.0),
    "heater": (160.0, 230.0, 85.0),
    "stirrer": (160.0, 230.0, 85.0),
    "balance": (195.0, 320.0, 70.0),
    "transmitter": (90.0, 60.0, 40.0),
    "timer": (60.0, 40.0, 40.0),
    "bench": (1200.0, 600.0, 30.0),
    "deck": (600.0, 400.0, 20.0),
    "storage": (300.0, 200.0, 200.0),
    "plate": (127.76, 85.48, 14.22),
    "tip_rack": (127.76, 85.48, 65.0),
    "tube_rack": (127.76, 85.48, 45.0),
    "carrier": (135.0, 497.0, 40.0),
    "workstation": (300.0, 260.0, 260.0),
    "continuous_pump": (120.0, 220.0, 140.0),
    "injection_valve": (60.0, 120.0, 80.0),
    "liquid_handler": (630.0, 570.0, 660.0),
    "powder_dispenser": (220.0, 400.0, 480.0),
    "shaker": (142.0, 99.0, 62.0),
    "furnace": (400.0, 450.0, 500.0),
    "chromatography": (350.0, 550.0, 600.0),
    "analyser": (350.0, 500.0, 600.0),
    "phase_separator": (250.0, 250.0, 500.0),
    "plate_reader": (400.0, 500.0, 280.0),
    "spectrometer": (400.0, 600.0, 420.0),
    "potentiostat": (120.0, 180.0, 60.0),
    "battery_tester": (430.0, 330.0, 130.0),
    "power_supply": (130.0, 300.0, 150.0),
    "camera": (60.0, 60.0, 80.0),
    "arm": (190.0, 190.0, 600.0),
    "gripper": (75.0, 75.0, 150.0),
    "gantry": (600.0, 500.0, 300.0),
    "agv": (700.0, 500.0, 250.0),
    "compute": (200.0, 400.0, 400.0),
    "cartridge": (25.0, 25.0, 70.0),
}
"""Typical instruments of the trade; plates have the outline of ANSI/SLAS 1-2004."""

_BOX: Vector = (90.0, 90.0, 70.0)
_SLENDERNESS = 1.6
_HEADROOM = 1.3
_VESSEL_UL = 50_000.0


def size_of(row: TwinResource) -> Vector:
    """Return width, depth and height."""
    if row.size_mm is not None and min(row.size_mm) > 0:
        return row.size_mm
    if row.kind in _BY_KIND:
        return _BY_KIND[row.kind]
    if is_vessel(row.kind):
        return _by_volume(row.capacity_ul or _VESSEL_UL)
    return _BOX


def _by_volume(capacity_ul: float) -> Vector:
    """Return the upright cylinder that holds the volume with some headroom; 1 µL is 1 mm³."""
    width = (4.0 * capacity_ul * _HEADROOM / (math.pi * _SLENDERNESS)) ** (1.0 / 3.0)
    return width, width, width * _SLENDERNESS
