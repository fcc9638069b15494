"""Steps of ultrasound, microwaves, centrifuges and condensers."""

from __future__ import annotations

import re
from fractions import Fraction

from labweb.domain.recipes.on_rig.choosing import resolve
from labweb.domain.recipes.on_rig.making import Making, say
from labweb.domain.recipes.on_rig.meetings import most_of
from labweb.domain.recipes.on_rig.moving import is_under_vacuum, look_for_room
from labweb.domain.recipes.on_rig.steps.conditions import above_zero, number
from labweb.domain.recipes.on_rig.wastes import look_at_meeting
from labweb.domain.recipes.on_rig.ways import RigMove
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicOperation

_SOUND = re.compile(r"ultra_?so|sonic")
_MICROWAVE = re.compile(r"microwave")
_CENTRIFUGE = re.compile(r"centrifuge")
_CONDENSER = re.compile(r"condenser|still")


def start_ultrasound(making: Making, operation: BasicOperation) -> None:
    """Put a vessel into ultrasound."""
    vessel = _filled(making, operation)
    if vessel is None:
        return
    bath = making.equipment.device(vessel, _SOUND)
    if bath is None:
        message = f"nothing gives ultrasound to {vessel}"
        making.told.tell("plan.no_ultrasound", message, operation.place, vessel=vessel)
        return
    making.running["sonicate", vessel] = bath
    does = {"kind": "sonicate", "vessel": vessel}
    making.add(operation.place, does, [[say(bath, "start_ultrasound")]])


def stop_ultrasound(making: Making, operation: BasicOperation) -> None:
    """Take it out of the ultrasound."""
    vessel = making.vessel(operation)
    bath = None if vessel is None else making.stopped("sonicate", vessel)
    if bath is not None:
        does = {"kind": "stop_sonicate", "vessel": vessel}
        making.add(operation.place, does, [[say(bath, "stop_ultrasound")]])


def microwave(making: Making, operation: BasicOperation) -> None:
    """Heat a closed vessel by microwaves; a person sees first that it is closed."""
    vessel = _filled(making, operation)
    if vessel is None:
        return
    device = making.equipment.device(vessel, _MICROWAVE)
    if device is None:
        message = f"no microwave heats {vessel}"
        making.told.tell("plan.no_microwave", message, operation.place, vessel=vessel)
        return
    given = {"temperature_c": number(operation.fields.get("temperature_c"))}
    given["power_w"] = above_zero(making, operation, "power_w")
    given["duration_s"] = number(operation.fields.get("seconds"))
    making.ask_first(
        f"{vessel} is closed, and bears the pressure that its contents have at "
        f"{given['temperature_c']:g} °C"
    )
    action = say(device, "heat_by_microwave", **given)
    does = {"kind": "microwave", "vessel": vessel, **given}
    making.add(operation.place, does, [*making.take_checks(), [action]])


def spin(making: Making, operation: BasicOperation) -> None:
    """Spin a vessel that is a centrifuge; a person sees first that it is balanced."""
    vessel = _filled(making, operation)
    if vessel is None:
        return
    if not _CENTRIFUGE.search(making.equipment.elements[vessel].kind.lower()):
        message = f"{vessel} is no centrifuge"
        making.told.tell("plan.no_centrifuge", message, operation.place, vessel=vessel)
        return
    names = ("speed_rpm", "acceleration_g")
    given = {name: above_zero(making, operation, name) for name in names}
    given["temperature_c"] = number(operation.fields.get("temperature_c"))
    given["duration_s"] = number(operation.fields.get("seconds"))
    making.ask_first(f"The rotor of {vessel} is balanced")
    making.matter.spin(vessel)
    does = {"kind": "spin", "vessel": vessel, **given}
    making.add(operation.place, does, [*making.take_checks(), [say(vessel, "spin", **given)]])


def distill(making: Making, operation: BasicOperation) -> None:
    """Let what boils in a vessel run over a condenser into another."""
    vessel = _filled(making, operation)
    target = None
    if vessel is not None:
        wanted = str(operation.fields.get("target", ""))
        target = resolve(making, wanted, vessel, operation.place)
    if vessel is None or target is None or is_under_vacuum(making, operation.place, target):
        return
    near = making.equipment.devices(vessel, _CONDENSER)
    condenser = next((key for key in near if target in making.equipment.near(key)), None)
    if condenser is None:
        message = f"no condenser leads from {vessel} to {target}"
        facts = {"vessel": vessel, "target": target}
        making.told.tell("plan.no_condenser", message, operation.place, **facts)
        return
    given = {
        "duration_s": number(operation.fields.get("seconds")),
        "vapour_c": number(operation.fields.get("vapour_c")),
    }
    move = RigMove(source=vessel, target=target, place=operation.place)
    look_for_room(making, move, Fraction(0), making.matter.liquid(vessel).most)
    gone = making.matter.loosen(vessel)
    film = making.film((), most_of(gone), target, making.traces_out_of(vessel, {}))
    look_at_meeting(making, vessel, target, gone, operation.place, film)
    making.bring(target, gone, vessel)
    does = {"kind": "distill", "vessel": vessel, "to": target, **given}
    action = say(condenser, "distill", **{"from": vessel}, to=target, **given)
    making.add(operation.place, does, [*making.take_checks(), [action]])


def _filled(making: Making, operation: BasicOperation) -> str | None:
    """Return the vessel, which holds liquid; None: it does not, which is told."""
    vessel = making.vessel(operation)
    if vessel is None or vessel in making.lost or making.matter.liquid(vessel).most:
        return vessel
    message = f"{making.operation}: {vessel} holds no liquid"
    making.told.tell("plan.nothing_there", message, operation.place)
    return None
