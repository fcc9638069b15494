"""What a driver must offer to play a role, and what its actions leave behind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any
from uuid import UUID

from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.enrollment.admitted_device import AdmittedDevice
from labweb.domain.enrollment.driver_spec import ParameterSpec
from labweb.domain.errors import Finding
from labweb.domain.resources.resource_tree import Tree

HEAT_TOLERANCE_C = 1.0
"""How near the temperature must be before *reached* is said."""

HOLD_TOLERANCE_C = 2.0
"""How far it may wander while it is held."""

SPEED_TOLERANCE_RATIO = 0.05
SPEED_TOLERANCE_RPM = 10.0
"""A stirrer has reached its speed within 5 %, or 10 rpm when that is more."""


@dataclass(frozen=True, slots=True)
class RoleOffer:
    """Actions and statuses by which a device is known to play a role."""

    actions: tuple[str, ...]
    statuses: tuple[str, ...] = ()


OFFERS: Mapping[str, RoleOffer] = {
    "pump": RoleOffer(("initialize", "aspirate", "dispense"), ("volume_ul", "is_initialized")),
    "valve": RoleOffer(("select_port",), ("port_index",)),
    "heater": RoleOffer(("heat_to", "hold", "stop_heating"), ("temperature_c",)),
    "thermostat": RoleOffer(("reach_temperature", "hold", "stop_control"), ("temperature_c",)),
    "rotary_evaporator": RoleOffer(
        ("heat_bath_to", "rotate", "lower_flask", "raise_flask", "stop_rotating", "stop_heating")
    ),
    "vacuum_controller": RoleOffer(("evacuate_to", "stop_pump", "vent"), ("pressure_kpa",)),
    "stirrer": RoleOffer(("stir", "stop_stirring"), ("speed_rpm",)),
    "balance": RoleOffer(("weigh",), ("mass_mg", "is_stable")),
    "ph": RoleOffer(("measure",), ("value_ph",)),
    "thermometer": RoleOffer(("measure",), ("temperature_c",)),
    "timer": RoleOffer(("wait",)),
    "camera": RoleOffer(("look",), ("sighting",)),
    "arm": RoleOffer(("run_program", "stop_program"), ("is_running",)),
}
"""Role by name. A device plays it when its driver declares all of these."""


READ_BEFORE: Mapping[str, tuple[str, ...]] = {
    "aspirate": ("is_initialized", "port_index", "volume_ul"),
    "dispense": ("is_initialized", "port_index", "volume_ul"),
}
"""Statuses of pump and valve that a plan has the host read before an action starts."""


def plays(device: AdmittedDevice, role: str) -> bool:
    """Tell whether a device's driver declares all that a role needs."""
    offer = OFFERS[role]
    actions = {action.name for action in device.spec.actions}
    statuses = {status.name for status in device.spec.statuses}
    return actions.issuperset(offer.actions) and statuses.issuperset(offer.statuses)


def acting_node(device: AdmittedDevice, action: str) -> UUID | None:
    """Return the resource that acts: the node of the action's role, or the only one.

    A driver of two trades, as a heater that stirs, may act through a node for each of them.
    """
    role = device.spec.action(action).role
    if role in device.nodes:
        return device.nodes[role]
    able = {name for name, offer in OFFERS.items() if action in offer.actions}
    nodes = {node for name, node in device.nodes.items() if name in able}
    nodes = nodes or set(device.nodes.values())
    return nodes.pop() if len(nodes) == 1 else None


def setting(device: AdmittedDevice, name: str) -> float | None:
    """Return a number from the device's settings, or its driver's default for it."""
    value = device.config.get(name)
    if value is None:
        value = next((p.default for p in device.spec.config if p.name == name), None)
    return _number(value)


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        return None
    return float(value)


def beyond_limits(
    device: AdmittedDevice, action: str, args: Mapping[str, Any], tree: Tree
) -> list[Finding]:
    """List the arguments beyond a `min_…` or `max_…` of the device's settings or its resources.

    A driver refuses what its settings forbid before anything moves; a plan has to know it before
    it is started. What people set on the resources counts as well.
    """
    said = {one.name: one for one in device.spec.action(action).parameters}
    found = []
    for name, value in args.items():
        number = _number(value)
        if number is None or name not in said:
            continue
        low, high = _limits(device, said[name], tree)
        if not low <= number <= high:
            bounds, unit = f"{low:g} to {high:g}".replace("inf", "∞"), said[name].symbol
            message = f"{device.name} goes from {bounds} {unit}; asked for {number:g} {unit}"
            ends = {end: one for end, one in (("low", low), ("high", high)) if isfinite(one)}
            found.append(Finding("plan.out_of_range", message, f"{action}.{name}", ends))
    return found


def _limits(device: AdmittedDevice, argument: ParameterSpec, tree: Tree) -> tuple[float, float]:
    """Return between which values an argument may be; infinite where nobody says so."""
    nodes = map(tree.by_id.get, device.nodes.values())
    configs = [one.config for one in nodes if one is not None]
    lows, highs = (
        [setting(device, name), *(_number(one.get(name)) for one in configs)]
        for name in (f"min_{argument.name}", f"max_{argument.name}")
    )
    # A largest value of 0, where the argument cannot be below, says that there is none.
    has_none = argument.minimum is not None and argument.minimum >= 0
    known = (one for one in highs if one is not None and not (one == 0 and has_none))
    return max((one for one in lows if one is not None), default=-inf), min(known, default=inf)


def recorded_data(action: str, args: Mapping[str, Any]) -> dict[str, Any]:
    """Return what an action leaves in its resource's `data` once it has succeeded."""
    match action:
        case "select_port":
            return {"port_index": args["port_index"]}
        case "initialize":
            return {"is_initialized": True}
        case "heat_to" | "hold" | "reach_temperature" | "heat_bath_to":
            return {"temperature_setpoint_c": args["temperature_c"]}
        case "stop_heating" | "stop_control":
            return {"temperature_setpoint_c": None}
        case "stir" | "rotate":
            return {"speed_setpoint_rpm": args["speed_rpm"]}
        case "evacuate_to":
            return {"pressure_setpoint_kpa": args["pressure_kpa"]}
        case "stop_pump" | "vent":
            return {"pressure_setpoint_kpa": None}
        case "stop_stirring" | "stop_rotating":
            return {"speed_setpoint_rpm": 0.0}
        case _:
            return {}


def read_statuses(device: AdmittedDevice, action: str) -> tuple[str, ...]:
    """Return the statuses that a reading action keeps with its event."""
    told = tuple(status.name for status in device.spec.statuses)
    wanted = {"weigh": ("mass_mg",), "measure": ("value_ph", "temperature_c")}.get(action, told)
    return tuple(name for name in wanted if name in told)


READ_AFTER: Mapping[str, str] = {
    "aspirate": "volume_ul",
    "dispense": "volume_ul",
    "select_port": "port_index",
    "initialize": "is_initialized",
    "heat_to": "temperature_c",
    "reach_temperature": "temperature_c",
    "heat_bath_to": "bath_temperature_c",
    "evacuate_to": "pressure_kpa",
    "hold": "temperature_c",
    "stir": "speed_rpm",
    "stop_stirring": "speed_rpm",
}
"""Status that a plan has the host read after an action, where the device tells it."""


def post_conditions(
    device: AdmittedDevice, action: str, args: Mapping[str, Any]
) -> tuple[Condition, ...]:
    """Return what the device's own statuses must say after an action."""
    conditions = {
        "select_port": lambda: _equals(device, "valve.at_port", "port_index", args["port_index"]),
        "initialize": lambda: _equals(device, "pump.is_initialized", "is_initialized", True),  # noqa: FBT003 - the value asked for
        "heat_to": lambda: _near(
            device, "heater.at_temperature", "temperature_c", args["temperature_c"],
            args["tolerance_c"],
        ),
        "reach_temperature": lambda: _near(
            device, "thermostat.at_temperature", "temperature_c", args["temperature_c"],
            args["tolerance_c"],
        ),
        "heat_bath_to": lambda: _near(
            device, "evaporator.bath_at_temperature", "bath_temperature_c", args["temperature_c"],
            args["tolerance_c"],
        ),
        "evacuate_to": lambda: _near(
            device, "vacuum.at_pressure", "pressure_kpa", args["pressure_kpa"],
            args["tolerance_kpa"],
        ),
        "hold": lambda: _near(
            device, "heater.held_temperature", "temperature_c", args["temperature_c"],
            args["tolerance_c"],
        ),
        "stir": lambda: _near(
            device, "stirrer.at_speed", "speed_rpm", args["speed_rpm"],
            max(args["speed_rpm"] * SPEED_TOLERANCE_RATIO, SPEED_TOLERANCE_RPM),
        ),
        "stop_stirring": lambda: _near(
            device, "stirrer.stands", "speed_rpm", 0.0, SPEED_TOLERANCE_RPM
        ),
    }  # fmt: skip
    make = conditions.get(action)
    if make is None:
        return ()
    condition = make()
    told = {status.name for status in device.spec.statuses}
    return (condition,) if condition.status in told else ()


def _equals(device: AdmittedDevice, name: str, status: str, value: bool | int) -> Condition:  # noqa: FBT001 - as in Condition
    return Condition(name=name, device_id=device.id, status=status, equals=value)


def _near(
    device: AdmittedDevice, name: str, status: str, value: float, tolerance: float
) -> Condition:
    return Condition(
        name=name, device_id=device.id, status=status, low=value, high=value, tolerance=tolerance
    )
