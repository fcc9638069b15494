"""Steps that stir, heat, chill, light, wait, measure or boil down."""

from __future__ import annotations

from decimal import Decimal
from typing import Any

from labweb.domain.recipes.on_rig.equipment import RigThermostat, VesselSort
from labweb.domain.recipes.on_rig.making import BESIDE, BY_HAND, TIMER, Making, estimate, say
from labweb.domain.recipes.on_rig.meetings import most_of
from labweb.domain.recipes.on_rig.wastes import look_at_meeting
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicOperation
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace
from labweb.domain.workflows.passes.liquids.stroke_pipeline import Group

RAMP_C_S = 2 / 60
"""Estimate: vessels warm and cool by 2 °C a minute."""

ROOM_C = 25.0
ROOMS_C = (15.0, 30.0)
"""Coldest and warmest of rooms, to which drifts what nothing heats or chills.

Source:
    USP 659, the excursions that controlled room temperature allows."""

EVAPORATION_S = 1800.0
"""Estimate for boiling down when nobody says a time."""


def start_stir(making: Making, operation: BasicOperation) -> None:
    """Stir; a rotary evaporator turns its flask instead."""
    vessel = making.vessel(operation)
    if vessel is None:
        return
    if making.equipment.sort(vessel) is VesselSort.ROTAVAP:
        start_rotation(making, operation)
        return
    speed = above_zero(making, operation, "speed_rpm")
    stirrer = making.equipment.stirrer(vessel)
    if stirrer is None:
        message = f"nothing stirs {vessel}"
        making.told.tell("plan.no_stirrer", message, operation.place, vessel=vessel)
        return
    _look_at_speed(making, operation, stirrer)
    making.running["stir", vessel] = stirrer
    does = {"kind": "stir", "vessel": vessel, "speed_rpm": speed}
    making.add(operation.place, does, [[say(stirrer, "stir", speed_rpm=speed)]])


def _look_at_speed(making: Making, operation: BasicOperation, device: str) -> None:
    """Tell what is slower or faster than a device's settings say that it goes."""
    wanted, (low, high) = operation.fields.get("speed_rpm"), making.equipment.speeds(device)
    if not isinstance(wanted, Decimal | int):
        return
    if (low is not None and wanted < low) or (high is not None and wanted > high):
        ends = " to ".join("?" if end is None else f"{end.normalize():f}" for end in (low, high))
        message = f"{device} goes from {ends} rpm, and is asked for {Decimal(wanted):f} rpm"
        making.told.tell("plan.out_of_range", message, operation.place, device=device)


def stop_stir(making: Making, operation: BasicOperation) -> None:
    """Stop stirring what is stirred."""
    vessel = making.vessel(operation)
    if vessel is None:
        return
    if making.equipment.sort(vessel) is VesselSort.ROTAVAP:
        stop_rotation(making, operation)
        return
    stirrer = making.stopped("stir", vessel)
    if stirrer is not None:
        does = {"kind": "stop_stir", "vessel": vessel}
        making.add(operation.place, does, [[say(stirrer, "stop_stirring")]])


def start_rotation(making: Making, operation: BasicOperation) -> None:
    """Turn the flask of a rotary evaporator."""
    vessel = _rotavap(making, operation)
    speed = above_zero(making, operation, "speed_rpm")
    if vessel is not None:
        device = making.equipment.evaporator(vessel)
        _look_at_speed(making, operation, device)
        making.running["rotate", vessel] = device
        does = {"kind": "rotate", "vessel": vessel, "speed_rpm": speed}
        making.add(operation.place, does, [[say(device, "start_rotation", speed_rpm=speed)]])


def stop_rotation(making: Making, operation: BasicOperation) -> None:
    """Stop turning it."""
    vessel = making.vessel(operation)
    device = None if vessel is None else making.stopped("rotate", vessel)
    if device is not None:
        does = {"kind": "stop_rotate", "vessel": vessel}
        making.add(operation.place, does, [[say(device, "stop_rotation")]])


def lower_flask(making: Making, operation: BasicOperation) -> None:
    """Put the flask into the bath."""
    vessel = _rotavap(making, operation)
    if vessel is not None:
        device = making.equipment.evaporator(vessel)
        making.running["lower", vessel] = device
        does = {"kind": "lower", "vessel": vessel}
        making.add(operation.place, does, [[say(device, "lower_flask")]])


def raise_flask(making: Making, operation: BasicOperation) -> None:
    """Take the flask out of the bath."""
    vessel = making.vessel(operation)
    device = None if vessel is None else making.stopped("lower", vessel)
    if device is not None:
        does = {"kind": "raise", "vessel": vessel}
        making.add(operation.place, does, [[say(device, "raise_flask")]])


def _rotavap(making: Making, operation: BasicOperation) -> str | None:
    vessel = making.vessel(operation)
    if vessel is None or making.equipment.sort(vessel) is VesselSort.ROTAVAP:
        return vessel
    message = f"{vessel} is a {making.equipment.sort(vessel)} and no rotary evaporator"
    making.told.tell("plan.no_rotavap", message, operation.place)
    return None


def set_temperature(making: Making, operation: BasicOperation) -> None:
    """Heat or chill with the device that reaches the temperature."""
    vessel, wanted = making.vessel(operation), operation.fields.get("temperature_c")
    if vessel is None or not isinstance(wanted, Decimal):
        return
    coldest, warmest = making.warmth_c.get(vessel, ROOMS_C)
    making.warmth_c[vessel] = (min(coldest, float(wanted)), max(warmest, float(wanted)))
    device = _thermostat(making, operation, vessel, wanted)
    if device is None:
        return
    before = making.running.get(("heat", vessel))
    if before is not None and before != device:
        stop_temperature(making, operation)
    actions: list[Group] = making.take_checks()
    actions.append([say(device, "set_temperature", temperature_c=float(wanted))])
    making.running["heat", vessel] = device
    does = {"kind": "heat", "vessel": vessel, "temperature_c": float(wanted)}
    making.add(operation.place, does, actions)


def _thermostat(
    making: Making, operation: BasicOperation, vessel: str, wanted: Decimal
) -> str | None:
    near = making.equipment.thermostats(vessel)
    running = making.running.get(("heat", vessel))
    able = [t for t in near if t.covers(wanted)]
    # The one that runs already, then a heater for what is warm and a chiller for what is cold.
    able.sort(key=lambda t: (t.key != running, _fitness(t, wanted), t.key))
    if able:
        return able[0].key
    unknown = [t.key for t in near if not t.is_beyond(wanted)]
    if unknown:
        making.ask_first(f"{unknown[0]} brings {vessel} to {wanted.normalize():f} °C")
        return unknown[0]
    if near:
        ranges = ", ".join(str(t) for t in near)
        message = f"{vessel} cannot be brought to {wanted.normalize():f} °C: {ranges}"
        code = "plan.out_of_range"
    else:
        message, code = f"nothing heats or chills {vessel}", "plan.no_thermostat"
    facts = {"vessel": vessel, "temperature_c": float(wanted)}
    making.told.tell(code, message, operation.place, **facts)
    return None


def _fitness(thermostat: RigThermostat, wanted: Decimal) -> int:
    is_heater = (thermostat.low_c or Decimal(0)) > 0
    return int(is_heater != (wanted >= Decimal(int(ROOM_C))))


def await_temperature(making: Making, operation: BasicOperation) -> None:
    """Wait until the vessel is in the window, driven or drifting."""
    vessel = making.vessel(operation)
    if vessel is None:
        return
    near = [t.key for t in making.equipment.thermostats(vessel)]
    device = making.running.get(("heat", vessel)) or next(iter(near), None)
    low, high = number(operation.fields.get("low_c")), number(operation.fields.get("high_c"))
    if device is None or low is None or high is None:
        if device is None:
            message = f"nothing tells the temperature of {vessel}"
            facts = {"vessel": vessel, "temperature_c": high if low is None else low}
            making.told.tell("plan.no_thermostat", message, operation.place, **facts)
        return
    is_driven = ("heat", vessel) in making.running
    if not is_driven and not _drifts_to(making, operation, vessel, low, high):
        return
    making.warmth_c[vessel] = (low, high)
    middle = (low + high) / 2
    seconds = abs(middle - making.temperatures_c.get(vessel, ROOM_C)) / RAMP_C_S
    making.temperatures_c[vessel] = middle
    does = {"kind": "reach", "vessel": vessel, "low_c": low, "high_c": high}
    action = say(device, "await_temperature", low_c=low, high_c=high)
    making.add(operation.place, does, [[action]], round(seconds, 3))


def _drifts_to(
    making: Making, operation: BasicOperation, vessel: str, low_c: float, high_c: float
) -> bool:
    """Tell whether a window is on the way of a vessel to the room; where not, it is told."""
    was = making.warmth_c.get(vessel, ROOMS_C)
    coldest, warmest = min(was[0], ROOMS_C[0]), max(was[1], ROOMS_C[1])
    if low_c <= warmest and high_c >= coldest:
        return True
    message = (
        f"{making.operation}: nothing heats or chills {vessel}, which is between {coldest:g} and "
        f"{warmest:g} °C and never gets between {low_c:g} and {high_c:g} °C by itself"
    )
    making.told.tell("plan.never_reached", message, operation.place, vessel=vessel)
    return False


def stop_temperature(making: Making, operation: BasicOperation) -> None:
    """Stop heating and chilling."""
    vessel = making.vessel(operation)
    device = None if vessel is None else making.stopped("heat", vessel)
    if device is not None:
        does = {"kind": "stop_heat", "vessel": vessel}
        making.add(operation.place, does, [[say(device, "stop_temperature")]])


def wait(making: Making, operation: BasicOperation) -> None:
    """Let time pass."""
    seconds = number(operation.fields.get("seconds"))
    if seconds is None:
        message = f"{making.operation} does not say how long"
        making.told.tell("xdl.left_open", message, operation.place)
        return
    if seconds > 0:
        does = {"kind": "wait", "duration_s": seconds}
        making.add(operation.place, does, [[say(TIMER, "wait", duration_s=seconds)]])


def evaporate(making: Making, operation: BasicOperation) -> None:
    """Boil down: that long, or until nothing comes, at most that long."""
    vessel = _rotavap(making, operation)
    if vessel is None:
        return
    seconds = number(operation.fields.get("seconds"))
    name = "most_s" if operation.fields.get("is_automatic") else "duration_s"
    collect = making.equipment.collecting(vessel)
    if collect is None:
        message = f"no way for vapour leads from {vessel} into a flask that it condenses in"
        making.told.tell("plan.no_condenser", message, operation.place, vessel=vessel)
        return
    gone = making.matter.loosen(vessel)
    capacity = making.capacity_nl(collect)
    film = making.film((), most_of(gone), collect, making.traces_out_of(vessel, {}))
    look_at_meeting(making, vessel, collect, gone, operation.place, film)
    making.bring(collect, gone, vessel)
    if capacity is not None and making.matter.liquid(collect).most > capacity:
        making.ask_first(f"The collecting flask of {vessel} has room for what boils off")
    given = {} if seconds is None else {name: seconds}
    device = making.equipment.evaporator(vessel)
    actions = [*making.take_checks(), [say(device, "evaporate", **given)]]
    does = {"kind": "evaporate", "vessel": vessel, **given}
    lasts = estimate(actions) if seconds is not None else EVAPORATION_S
    making.add(operation.place, does, actions, lasts)


def start_light(making: Making, operation: BasicOperation) -> None:
    """Light a vessel."""
    vessel = making.vessel(operation)
    if vessel is None:
        return
    lamp = making.equipment.lamp(vessel)
    if lamp is None:
        message = f"nothing lights {vessel}"
        making.told.tell("plan.no_lamp", message, operation.place, vessel=vessel)
        return
    names = ("wavelength_nm", "power_w", "intensity_percent")
    given: dict[str, Any] = {name: above_zero(making, operation, name) for name in names}
    given["color"] = operation.fields.get("color")
    making.running["light", vessel] = lamp
    does = {"kind": "light", "vessel": vessel, **given}
    making.add(operation.place, does, [[say(lamp, "start_light", **given)]])


def stop_light(making: Making, operation: BasicOperation) -> None:
    """Turn the lamp off."""
    vessel = making.vessel(operation)
    lamp = None if vessel is None else making.stopped("light", vessel)
    if lamp is not None:
        does = {"kind": "stop_light", "vessel": vessel}
        making.add(operation.place, does, [[say(lamp, "stop_light")]])


def measure(making: Making, operation: BasicOperation) -> None:
    """Take one reading, and compare it where the recipe says between what it is done."""
    vessel, fields = making.vessel(operation), operation.fields
    quantity = str(fields.get("quantity", ""))
    if vessel is not None:
        window = (number(fields.get("least")), number(fields.get("most")))
        read(making, operation.place, vessel, quantity, window)


def read(
    making: Making,
    place: FilePlace,
    vessel: str,
    quantity: str,
    window: tuple[float | None, float | None],
) -> None:
    """Take one reading of a vessel; the window says between what it is done."""
    sensor = making.equipment.sensor(vessel, quantity)
    if sensor is None:
        message = f"no sensor at {vessel} reads {quantity}"
        facts = {"vessel": vessel, "quantity": quantity}
        making.told.tell("plan.no_sensor", message, place, **facts)
    low, high = window
    if low is not None or high is not None:
        making.readings.append(len(making.steps))
    if sensor is not None:
        does = {"kind": "measure", "vessel": vessel, "quantity": quantity, "low": low, "high": high}
        making.add(place, does, [[say(sensor, "measure", quantity=quantity, low=low, high=high)]])


def ask(making: Making, operation: BasicOperation) -> None:
    """Ask a person."""
    text = str(operation.fields.get("message", "")) or "Go on?"
    making.add(operation.place, {"kind": "ask", "text": text}, [[say(BY_HAND, "check", text=text)]])


def await_lane(making: Making, operation: BasicOperation) -> None:
    """Let the next step wait for what runs beside."""
    making.waits_for |= {f"{BESIDE}{operation.fields.get('pid')}"}


def above_zero(making: Making, operation: BasicOperation, name: str) -> float | None:
    """Return a number of an operation as JSON has it; one that is not above zero is told."""
    found = number(operation.fields.get(name))
    if found is not None and found <= 0:
        message = f"{making.operation}: {name} is {found:g}, and has to be more than 0"
        making.told.tell("unit.not_positive", message, operation.place)
    return found


def number(value: object) -> float | None:
    """Return a number of a recipe as JSON has it."""
    return float(value) if isinstance(value, Decimal | int) else None
