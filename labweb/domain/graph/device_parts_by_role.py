"""What stands in the tree for each role of a driver, and which roles bring nothing, and why.

What takes several things is a place itself: the pan of a balance, the chamber of a furnace. What
takes one thing and no other at a time has a slot for it. Vessels, labware, cells and columns come
with people and not with a device, but for those that are a part of it: syringe, sample loop, and
the vessel of a separator.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Something that lies inside a part, and through which the device does not act."""

    key: str
    """Appended to that in which it lies; `{}` stands for its number."""

    label: str
    kind: str = "slot"
    each: str = ""
    """Setting that says which there are: a count, or names as keys; empty: there is one."""

    inside: str = ""
    """Key of another place of the part; empty: in the part itself."""

    settings: Mapping[str, str] = field(default_factory=dict)
    """As in `Sort`."""


@dataclass(frozen=True, slots=True)
class Sort:
    """What stands in the tree for a role."""

    kind: str
    settings: Mapping[str, str] = field(default_factory=dict)
    """Field of the resource → setting of the driver, of the same unit."""

    fixed: Mapping[str, Any] = field(default_factory=dict)
    roles: tuple[str, ...] = ()
    """As what it stands in the tree; empty: as the role itself."""

    places: tuple[Place, ...] = ()
    joins: tuple[str, ...] = ()
    """Roles whose part it acts through, where the driver has one of them too."""


_HEATS = {"max_temperature_c": "max_temperature_c", "min_temperature_c": "min_temperature_c"}
_STIRS = {"max_speed_rpm": "max_speed_rpm", "min_speed_rpm": "min_speed_rpm"}
_SYRINGE = {"capacity_ul": "syringe_ul"}

SORTS: Mapping[str, Sort] = {
    "pump": Sort("syringe_pump", _SYRINGE),
    "infusion_pump": Sort("syringe_pump", _SYRINGE),
    "continuous_pump": Sort("continuous_pump"),
    "valve": Sort("rotary_valve", {"ports_count": "ports_count"}, {"common_port": "common"}),
    "injection_valve": Sort(
        "injection_valve",
        places=(
            Place(
                key="_loop",
                label="sample loop",
                kind="sample_loop",
                settings={"capacity_ul": "loop_ul"},
            ),
        ),
    ),
    "liquid_handler": Sort(
        "liquid_handler",
        places=(
            Place(key="_pipette", label="pipette", kind="pipette_channel"),
            Place(key="_deck", label="deck", kind="deck"),
            Place(key="/{}", label="slot {}", each="deck", inside="_deck"),
        ),
    ),
    "powder_dispenser": Sort(
        "powder_dispenser",
        places=(
            Place(key="_head", label="place of the dosing head"),
            Place(key="_vial", label="place of the vial"),
        ),
    ),
    "heater_stirrer": Sort("heater_stirrer", {**_HEATS, **_STIRS}, roles=("heater", "stirrer")),
    "stirrer": Sort("stirrer", _STIRS),
    "shaker": Sort(
        "shaker",
        {**_HEATS, **_STIRS},
        places=(Place(key="_plate", label="place of the plate"),),
    ),
    "thermostat": Sort("thermostat", _HEATS),
    "furnace": Sort("furnace", _HEATS),
    "rotary_evaporator": Sort("rotary_evaporator", {**_HEATS, **_STIRS}),
    "separator": Sort(
        "phase_separator",
        _STIRS,
        places=(
            Place(
                key="_vessel",
                label="vessel",
                kind="separator",
                settings={"capacity_ul": "vessel_ul"},
            ),
        ),
    ),
    "vacuum_controller": Sort("vacuum_controller"),
    "chromatography": Sort(
        "chromatography",
        places=(
            Place(key="_column", label="place of the column"),
            Place(key="_collector", label="fraction collector", kind="carrier"),
        ),
    ),
    "analyser": Sort(
        "analyser", places=(Place(key="_tray", label="tray of vials", kind="carrier"),)
    ),
    "plate_reader": Sort("plate_reader", _HEATS, places=(Place(key="_drawer", label="drawer"),)),
    "temperature_controller": Sort("heater", _HEATS, joins=("plate_reader", "shaker")),
    "spectrometer": Sort("spectrometer", places=(Place(key="_bore", label="bore"),)),
    "potentiostat": Sort("potentiostat"),
    "battery_tester": Sort(
        "battery_tester", places=(Place(key="_cell", label="place of the cell"),)
    ),
    "power_supply": Sort("power_supply"),
    "balance": Sort("balance"),
    "camera": Sort("camera"),
    "timer": Sort("timer"),
    "ph_sensor": Sort("transmitter", roles=("transmitter",)),
    "tds_sensor": Sort("transmitter", roles=("transmitter",)),
    "conductivity_sensor": Sort("transmitter", roles=("conductivity_sensor",)),
    "temperature_sensor": Sort("transmitter"),
    "flow_sensor": Sort("transmitter"),
    "storage": Sort(
        "storage",
        places=(
            Place(key="_slot_{}", label="place {}", each="slots_count"),
            Place(key="_transfer", label="transfer station"),
        ),
    ),
    "arm": Sort("arm"),
    "gripper": Sort("gripper", places=(Place(key="_fingers", label="fingers"),)),
    "gantry": Sort("gantry"),
    "agv": Sort("agv"),
    "compute": Sort("compute"),
}
"""What stands in the tree for each role."""

WITHOUT_PARTS: Mapping[str, str] = {
    "showing": (
        "a display is on a device that has another role, and shows a text; nothing stands in it, "
        "and no liquid passes"
    ),
    "node": (
        "what a foreign node is, a vehicle, a sensor or a whole station, its driver does not "
        "know: a person names the resource that it acts through"
    ),
}
"""Roles for which nothing comes into the tree, and why."""
