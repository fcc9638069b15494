"""Which device does what, and on which vessels it acts."""

from __future__ import annotations

import re
from collections.abc import Mapping

from labweb.domain.graph.elements import Element, ElementRole
from labweb.domain.proof.plumbing import Plumbing, is_evaporator

_HOTPLATE = re.compile(r"hot_?plate|rct|ret_?(control|visc)|heat_?chill|heater_?stirrer")
_STIRRER = re.compile(r"heitorque|rzr_?2052|microstar|stirrer|vortex")
_HEATER = re.compile(r"julabo|cf41|huber|heat(?!orque)|chill|cool|cryo|thermostat")
_SENSOR = re.compile(r"sensor|camera|meter$|probe|transmitter|balance")
_LAMP = re.compile(r"lamp|light|led$|led_|photo")
_PNEUMATIC = re.compile(r"pneumatic")
_SOUND = re.compile(r"ultra_?so|sonic")
_MICROWAVE = re.compile(r"microwave")
_CONDENSER = re.compile(r"condenser|still")
_CENTRIFUGE = re.compile(r"centrifuge")
_EVAPORATOR = re.compile(r"rotary_?evaporator")
"""A rotary evaporator whose flasks are vessels of their own."""

_LINE = re.compile(r"chemputer_?vacuum|vacuum_?line")

ACTIONS_OF: Mapping[str, frozenset[str]] = {
    "stirrer": frozenset(("stir", "stop_stirring")),
    "heater": frozenset(("set_temperature", "await_temperature", "stop_temperature")),
    "evaporator": frozenset(
        [
            "set_temperature",
            "await_temperature",
            "stop_temperature",
            "start_rotation",
            "stop_rotation",
            "lower_flask",
            "raise_flask",
            "evaporate",
        ]
    ),
    "vacuum": frozenset(("start_vacuum", "stop_vacuum", "vent")),
    "pneumatic": frozenset(("set_supply",)),
    "sensor": frozenset(("measure",)),
    "boundary": frozenset(("watch_boundary", "stop_watching")),
    "lamp": frozenset(("start_light", "stop_light")),
    "sound": frozenset(("start_ultrasound", "stop_ultrasound")),
    "microwave": frozenset(["heat_by_microwave"]),
    "condenser": frozenset(["distill"]),
    "centrifuge": frozenset(["spin"]),
}
_LIQUID = {
    ElementRole.VALVE: frozenset(("set_port",)),
    ElementRole.SOLENOID: frozenset(("open", "close")),
}


def abilities(element: Element) -> frozenset[str]:
    """Return the actions that an element has, by its role and class."""
    if element.role is ElementRole.PUMP:
        more = {"set_port"} if element.selects else set()
        return frozenset({"aspirate", "dispense"} | more)
    if element.role in _LIQUID:
        return _LIQUID[element.role]
    if is_evaporator(element):
        return ACTIONS_OF["evaporator"]
    if element.role is ElementRole.VACUUM:
        return frozenset() if is_line(element) else ACTIONS_OF["vacuum"]
    word = element.kind.lower()
    if element.role is ElementRole.VESSEL:
        is_itself = (("centrifuge", _CENTRIFUGE), ("microwave", _MICROWAVE))
        own = [sort for sort, pattern in is_itself if pattern.search(word)]
        return frozenset(action for sort in own for action in ACTIONS_OF[sort])
    if element.role is not ElementRole.OTHER:
        return frozenset()
    sorts = [
        sort
        for sort, is_it in (
            ("stirrer", _STIRRER.search(word) or _HOTPLATE.search(word)),
            ("heater", _HEATER.search(word) or _HOTPLATE.search(word)),
            ("evaporator", _EVAPORATOR.search(word)),
            ("pneumatic", _PNEUMATIC.search(word)),
            ("sensor", _SENSOR.search(word)),
            ("boundary", "conductivity" in word),
            ("lamp", _LAMP.search(word)),
            ("sound", _SOUND.search(word)),
            ("microwave", _MICROWAVE.search(word)),
            ("condenser", _CONDENSER.search(word)),
        )
        if is_it
    ]
    return frozenset(action for sort in sorts for action in ACTIONS_OF[sort])


def is_line(element: Element) -> bool:
    """Tell whether an element is a vacuum line without a pump of its own."""
    return element.role is ElementRole.VACUUM and bool(_LINE.search(element.kind.lower()))


def vessels_of(plumbing: Plumbing, device: str) -> list[str]:
    """Return the vessels that a device acts on: itself, or those that a link joins it to."""
    if plumbing.is_vessel(device):
        return [device]
    return sorted(key for key in plumbing.neighbours(device) if plumbing.is_vessel(key))


def devices_at(plumbing: Plumbing, vessel: str, action: str) -> list[str]:
    """Return the devices that have an action and act on a vessel."""
    near = [vessel, *sorted(plumbing.neighbours(vessel))]
    return [
        key
        for key in near
        if key in plumbing.elements and action in abilities(plumbing.elements[key])
    ]


def pumps_of(plumbing: Plumbing, line: str) -> list[str]:
    """Return the vacuum pumps that draw a line down; none: it is on all the time."""
    if not is_line(plumbing.elements[line]):
        return [line]
    near = (plumbing.elements[key] for key in sorted(plumbing.neighbours(line)))
    return [one.key for one in near if one.role is ElementRole.VACUUM and not is_line(one)]
