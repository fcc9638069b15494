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
class RolePlace:
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
    """As in `RoleParts`."""


@dataclass(frozen=True, slots=True)
class RoleParts:
    """What stands in the tree for a role."""

    kind: str
    settings: Mapping[str, str] = field(default_factory=dict)
    """Field of the resource → setting of the driver, of the same unit."""

    fixed: Mapping[str, Any] = field(default_factory=dict)
    roles: tuple[str, ...] = ()
    """As what it stands in the tree; empty: as the role itself."""

    places: tuple[RolePlace, ...] = ()
    joins: tuple[str, ...] = ()
    """Roles whose part it acts through, where the driver has one of them too."""


_HEATS = {"max_temperature_c": "max_temperature_c", "min_temperature_c": "min_temperature_c"}
_STIRS = {"max_speed_rpm": "max_speed_rpm", "min_speed_rpm": "min_speed_rpm"}
_SYRINGE = {"capacity_ul": "syringe_ul"}

SORTS: Mapping[str, RoleParts] = {
    "pump": RoleParts("syringe_pump", _SYRINGE),
    "infusion_pump": RoleParts("syringe_pump", _SYRINGE),
    "continuous_pump": RoleParts("continuous_pump"),
    "valve": RoleParts("rotary_valve", {"ports_count": "ports_count"}, {"common_port": "common"}),
    "injection_valve": RoleParts(
        "injection_valve",
        places=(
            RolePlace(
                key="_loop",
                label="sample loop",
                kind="sample_loop",
                settings={"capacity_ul": "loop_ul"},
            ),
        ),
    ),
    "liquid_handler": RoleParts(
        "liquid_handler",
        places=(
            RolePlace(key="_pipette", label="pipette", kind="pipette_channel"),
            RolePlace(key="_deck", label="deck", kind="deck"),
            RolePlace(key="/{}", label="slot {}", each="deck", inside="_deck"),
        ),
    ),
    "powder_dispenser": RoleParts(
        "powder_dispenser",
        places=(
            RolePlace(key="_head", label="place of the dosing head"),
            RolePlace(key="_vial", label="place of the vial"),
        ),
    ),
    "heater_stirrer": RoleParts(
        "heater_stirrer", {**_HEATS, **_STIRS}, roles=("heater", "stirrer")
    ),
    "stirrer": RoleParts("stirrer", _STIRS),
    "shaker": RoleParts(
        "shaker",
        {**_HEATS, **_STIRS},
        places=(RolePlace(key="_plate", label="place of the plate"),),
    ),
    "thermostat": RoleParts("thermostat", _HEATS),
    "furnace": RoleParts("furnace", _HEATS),
    "rotary_evaporator": RoleParts("rotary_evaporator", {**_HEATS, **_STIRS}),
    "separator": RoleParts(
        "phase_separator",
        _STIRS,
        places=(
            RolePlace(
                key="_vessel",
                label="vessel",
                kind="separator",
                settings={"capacity_ul": "vessel_ul"},
            ),
        ),
    ),
    "vacuum_controller": RoleParts("vacuum_controller"),
    "chromatography": RoleParts(
        "chromatography",
        places=(
            RolePlace(key="_column", label="place of the column"),
            RolePlace(key="_collector", label="fraction collector", kind="carrier"),
        ),
    ),
    "analyser": RoleParts(
        "analyser", places=(RolePlace(key="_tray", label="tray of vials", kind="carrier"),)
    ),
    "plate_reader": RoleParts(
        "plate_reader", _HEATS, places=(RolePlace(key="_drawer", label="drawer"),)
    ),
    "temperature_controller": RoleParts("heater", _HEATS, joins=("plate_reader", "shaker")),
    "spectrometer": RoleParts("spectrometer", places=(RolePlace(key="_bore", label="bore"),)),
    "potentiostat": RoleParts("potentiostat"),
    "battery_tester": RoleParts(
        "battery_tester", places=(RolePlace(key="_cell", label="place of the cell"),)
    ),
    "power_supply": RoleParts("power_supply"),
    "balance": RoleParts("balance"),
    "camera": RoleParts("camera"),
    "timer": RoleParts("timer"),
    "ph_sensor": RoleParts("transmitter", roles=("transmitter",)),
    "tds_sensor": RoleParts("transmitter", roles=("transmitter",)),
    "conductivity_sensor": RoleParts("transmitter", roles=("conductivity_sensor",)),
    "temperature_sensor": RoleParts("transmitter"),
    "flow_sensor": RoleParts("transmitter"),
    "storage": RoleParts(
        "storage",
        places=(
            RolePlace(key="_slot_{}", label="place {}", each="slots_count"),
            RolePlace(key="_transfer", label="transfer station"),
        ),
    ),
    "arm": RoleParts("arm"),
    "gripper": RoleParts("gripper", places=(RolePlace(key="_fingers", label="fingers"),)),
    "gantry": RoleParts("gantry"),
    "agv": RoleParts("agv"),
    "compute": RoleParts("compute"),
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
