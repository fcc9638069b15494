"""Steps that put vacuum or gas on a vessel, and take it off again."""

from __future__ import annotations

from typing import Any

from labweb.domain.graph.elements import ElementRole
from labweb.domain.recipes.on_rig.choosing import resolve
from labweb.domain.recipes.on_rig.equipment import INERT, VesselSort
from labweb.domain.recipes.on_rig.lines import (
    GasLine,
    drawn_with,
    find_line,
    resting_port,
    vacuum_line,
)
from labweb.domain.recipes.on_rig.making import Making, say
from labweb.domain.recipes.on_rig.moving import move_all
from labweb.domain.recipes.on_rig.steps.conditions import number
from labweb.domain.recipes.on_rig.ways import RigMove
from labweb.domain.recipes.xdl.expansion.basic_operations import INERT_GAS, WASTE, BasicOperation
from labweb.domain.recipes.xdl.file_format.xml_tree import NOWHERE, FilePlace
from labweb.domain.workflows.passes.liquids.stroke_pipeline import DeviceCommand, Group


def start_vacuum(making: Making, operation: BasicOperation) -> None:
    """Evacuate a vessel; what is liquid in it may boil off."""
    vessel = making.vessel(operation)
    if vessel is None:
        return
    pressure = number(operation.fields.get("pressure_mbar"))
    does: dict[str, Any] = {"kind": "vacuum", "vessel": vessel, "pressure_mbar": pressure}
    actions: list[Group]
    controller = making.equipment.pneumatic(vessel)
    if controller is not None:
        actions = [[say(controller[0], "set_supply", port=controller[1], supply="vacuum")]]
        making.evacuated[vessel] = ""
        making.running["vacuum", vessel] = controller[0]
        _say_unset(making, vessel, controller[0], pressure)
    else:
        found = _vacuum_line(making, operation, vessel)
        if found is None:
            return
        line, pump = found
        actions = []
        if pump is not None:
            making.also[vessel] = _drawn_too(making, operation.place, vessel, pump)
            if vessel not in making.evacuated:
                does["also"] = list(making.also[vessel]) or None
            actions += _close_others(making, vessel, line, pump)
            actions += [[say(pump, "start_vacuum", pressure_mbar=pressure)]]
        else:
            _say_unset(making, vessel, line.end, pressure)
        actions += _join(making, vessel, line)
        making.evacuated[vessel] = pump or ""
        making.running["vacuum", vessel] = pump or line.end
    making.matter.loosen(vessel)
    making.add(operation.place, does, actions)


def _say_unset(making: Making, vessel: str, source: str, pressure: float | None) -> None:
    if pressure is not None:
        making.note(
            f"{making.operation}: the vacuum of {source} on {vessel} is as it is, and no device "
            f"sets it to {pressure:g} mbar"
        )


def _vacuum_line(
    making: Making, operation: BasicOperation, vessel: str
) -> tuple[GasLine, str | None] | None:
    port = operation.fields.get("port")
    line = vacuum_line(making.equipment, vessel, str(port) if port else None)
    if line is None:
        if making.operation in ("Filter", "WashSolid"):
            making.note(f"{vessel} has no vacuum: its solid is not sucked dry")
        else:
            message = f"no valve joins {vessel} to a vacuum"
            making.told.tell("plan.no_vacuum", message, operation.place, vessel=vessel)
        return None
    return line, making.equipment.vacuum_pump(line.end)


def _drawn_too(making: Making, place: FilePlace, vessel: str, pump: str) -> tuple[str, ...]:
    """Return the empty vessels that the pump draws on too; what would do harm is told."""
    others = [key for key in drawn_with(making.equipment, pump) if key != vessel]
    held = [key for key in others if making.matter.held(key)]
    for key in (key for key in held if key not in making.lost):
        message = (
            f"{pump} evacuates {vessel} and draws on {key} too, which may hold something: "
            f"a valve between {key} and {pump} is missing"
        )
        facts = {"vessel": vessel, "pump": pump, "other": key}
        making.told.tell("plan.vacuum_shared", message, place, **facts)
    for key in sorted(k for k, p in making.evacuated.items() if p == pump and k != vessel):
        message = f"{pump} draws on {key} already, and would change its vacuum with {vessel}"
        making.told.tell("plan.vacuum_shared", message, place)
    return tuple(key for key in others if key not in held)


def _close_others(making: Making, vessel: str, line: GasLine, pump: str) -> list[Group]:
    """Turn valves off the vacuum of a pump that nobody has turned yet: they may stand anywhere."""
    found = []
    for other in making.equipment.vessels:
        theirs = vacuum_line(making.equipment, other)
        if other == vessel or theirs is None or not theirs.valves:
            continue
        valve, busy = theirs.valves[0]
        is_known = valve in making.turned or valve in dict(line.valves)
        if is_known or making.equipment.vacuum_pump(theirs.end) != pump:
            continue
        port = resting_port(making.equipment, valve, busy)
        if port is not None:
            found.append(say(valve, "set_port", port=port))
    return [found] if found else []


def close_vacuum(making: Making) -> None:
    """Take the vessels of the plan off vacuum that is always on, before anything else is done."""
    used = {*making.binding.vessels.values(), *making.binding.flasks()}
    turns: dict[str, DeviceCommand] = {}
    vessels = []
    for vessel in making.equipment.vessels:
        line = vacuum_line(making.equipment, vessel)
        if line is None or making.equipment.vacuum_pump(line.end) is not None or line.solenoids:
            continue
        if vessel not in used and not making.matter.held(vessel):
            continue
        valve, busy = line.valves[0] if line.valves else ("", "")
        port = resting_port(making.equipment, valve, busy) if valve else None
        if port is None:
            message = f"{line.end} is always on, and no valve takes {vessel} off it"
            making.told.tell("plan.no_valve", message, NOWHERE)
            continue
        turns.setdefault(valve, say(valve, "set_port", port=port))
        vessels.append(vessel)
    with making.naming("Prepare"):
        for vessel in vessels:
            making.add(NOWHERE, {"kind": "vent", "vessel": vessel}, [[*turns.values()]])


def _join(making: Making, vessel: str, line: GasLine) -> list[Group]:
    actions: list[Group] = _shut(making, vessel)
    making.joined[vessel] = dict(line.valves)
    making.opened[vessel] = line.solenoids
    turned = [say(valve, "set_port", port=port) for valve, port in line.valves]
    opened = [say(solenoid, "open") for solenoid in line.solenoids]
    return [*actions, *([turned] if turned else []), *([opened] if opened else [])]


def _shut(making: Making, vessel: str) -> list[Group]:
    closed = [say(solenoid, "close") for solenoid in making.opened.pop(vessel, ())]
    return [closed] if closed else []


def _part(making: Making, vessel: str, place: FilePlace) -> list[Group]:
    """Turn the valve nearest to the vessel away from gas and vacuum."""
    actions = _shut(making, vessel)
    valves = making.joined.pop(vessel, {})
    for valve, busy in list(valves.items())[:1]:
        port = resting_port(making.equipment, valve, busy)
        if port is None:
            message = f"{valve} has no port at which {vessel} is at neither gas nor vacuum"
            making.told.tell("plan.no_valve", message, place)
        else:
            actions.append([say(valve, "set_port", port=port)])
    return actions


def stop_vacuum(making: Making, operation: BasicOperation) -> None:
    """Stop the vacuum and let the vessel come back to ambient pressure."""
    vessel = making.vessel(operation)
    if vessel is None or making.evacuated.pop(vessel, None) is None:
        return
    device = making.running.pop(("vacuum", vessel))
    does: dict[str, Any] = {"kind": "vent", "vessel": vessel}
    does["also"] = list(making.also.pop(vessel, ())) or None
    gas = operation.fields.get("gas")
    controller = making.equipment.pneumatic(vessel)
    if controller is not None:
        supply = "gas" if gas else "none"
        actions: list[Group] = [[say(device, "set_supply", port=controller[1], supply=supply)]]
        does["gas"] = device if gas else None
    else:
        line = _gas_line(making, operation, vessel, str(gas)) if gas else None
        actions = (
            _part(making, vessel, operation.place) if line is None else _join(making, vessel, line)
        )
        does["gas"] = None if line is None else line.end
        if making.equipment.elements[device].role is ElementRole.VACUUM and (
            making.equipment.vacuum_pump(device) == device
        ):
            actions += [[say(device, "stop_vacuum")], [say(device, "vent")]]
    making.add(operation.place, does, actions)
    if making.equipment.sort(vessel) is VesselSort.ROTAVAP:
        _drain(making, vessel, operation)


def _drain(making: Making, vessel: str, operation: BasicOperation) -> None:
    """Let what has boiled off run into a waste, where the collecting flask has a tube."""
    collect = making.equipment.collecting(vessel)
    if collect is None or not making.equipment.drains(vessel):
        return
    if not making.matter.liquid(collect).most:
        return
    waste = resolve(making, WASTE, collect, operation.place)
    if waste is not None:
        move_all(making, RigMove(source=collect, target=waste, place=operation.place))


def _gas_line(making: Making, operation: BasicOperation, vessel: str, name: str) -> GasLine | None:
    wanted = INERT if name == INERT_GAS else frozenset({name.strip().lower()})
    port = operation.fields.get("port")
    line = find_line(
        making.equipment,
        vessel,
        lambda key: making.equipment.gas(key) in wanted,
        str(port) if port else None,
    )
    if line is None:
        what = "an inert gas" if name == INERT_GAS else name
        message = f"no valve joins {vessel} to {what}"
        gas = max(wanted)
        facts = {"vessel": vessel, "gas": gas, "is_any_inert": name == INERT_GAS}
        making.told.tell("plan.no_gas", message, operation.place, **facts)
    return line


def start_gas(making: Making, operation: BasicOperation) -> None:
    """Let gas into a vessel."""
    vessel = making.vessel(operation)
    if vessel is None:
        return
    name = str(operation.fields.get("gas", INERT_GAS))
    controller = making.equipment.pneumatic(vessel)
    if controller is not None:
        device, end = controller[0], controller[0]
        actions: list[Group] = [[say(device, "set_supply", port=controller[1], supply="gas")]]
    else:
        line = _gas_line(making, operation, vessel, name)
        if line is None:
            return
        device = end = line.end
        actions = _join(making, vessel, line)
    for name, unit in (("flow_ml_min", "mL/min"), ("pressure_mbar", "mbar")):
        wanted = number(operation.fields.get(name))
        if wanted is not None:
            making.ask_first(f"The gas from {end} to {vessel} is set to {wanted:g} {unit}")
    making.running["gas", vessel] = device
    checks = making.take_checks()
    making.add(operation.place, {"kind": "gas", "vessel": vessel, "gas": end}, checks + actions)


def stop_gas(making: Making, operation: BasicOperation) -> None:
    """Stop the gas."""
    vessel = making.vessel(operation)
    device = None if vessel is None else making.stopped("gas", vessel)
    if vessel is None or device is None:
        return
    controller = making.equipment.pneumatic(vessel)
    if controller is not None:
        actions: list[Group] = [[say(device, "set_supply", port=controller[1], supply="none")]]
    else:
        actions = _part(making, vessel, operation.place)
    making.add(operation.place, {"kind": "stop_gas", "vessel": vessel, "gas": device}, actions)
