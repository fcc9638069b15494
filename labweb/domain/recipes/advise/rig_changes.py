"""The changes of a rig that labweb knows: each is drawn into a graph, or cannot be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.recipes.advise.add_cartridge import add_cartridge, move_cartridge
from labweb.domain.recipes.advise.add_waste import add_waste
from labweb.domain.recipes.advise.draw_chemputer_graph import (
    Drawing,
    DrawnPort,
    NotDrawnError,
    size_for,
)
from labweb.domain.recipes.on_rig.equipment import INERT, Equipment, VesselSort

FIRST_ML = 100
"""Size of a vessel that is added, unless more comes into it."""

_CLASSES = {
    VesselSort.REACTOR: ("ChemputerReactor", "reactor"),
    VesselSort.FILTER: ("ChemputerFilter", "filter"),
    VesselSort.SEPARATOR: ("ChemputerSeparator", "separator"),
    VesselSort.ROTAVAP: ("IKARV10", "rotavap"),
    VesselSort.FLASK: ("ChemputerFlask", "flask"),
    VesselSort.WASTE: ("ChemputerWaste", "waste"),
}
_ROOM_C = 25.0
_NEW = frozenset({"add_flask", "add_vessel", "add_cartridge", "add_waste"})
"""Changes whose subject is not in the graph before."""

_TWO_WAY = {VesselSort.REACTOR: "0", VesselSort.SEPARATOR: "bottom", VesselSort.FLASK: "0"}
ATTACHED = {
    "stirrer": "HeiTORQUE_100",
    "lamp": "Lamp",
    "ultrasonic bath": "UltrasonicBath",
    "microwave": "Microwave",
    "condenser": "Condenser",
}
"""Class that a device is drawn as; any of its sort does."""


@dataclass(frozen=True, slots=True)
class DrawableChange:
    """One change, before it is known where there is room for it."""

    kind: str
    subject: str
    value: str | float | tuple[float, ...] = ""

    @property
    def degrees(self) -> tuple[float, ...]:
        """Return the temperatures that a thermostat has to reach, the coldest first."""
        return self.value if isinstance(self.value, tuple) else ()

    @property
    def streams(self) -> list[str]:
        """Return the streams that a waste is to take."""
        return sorted(str(self.value).split(",")) if self.value else []

    @property
    def amount(self) -> float:
        """Return how much a vessel has to hold, in millilitres."""
        return self.value if isinstance(self.value, float) else 0.0

    @property
    def is_named(self) -> bool:
        """Tell whether the recipe itself names what is added, or how much comes into it."""
        is_any = (
            not self.subject or self.value == VesselSort.WASTE.value or self.kind == "add_waste"
        )
        return self.kind in _NEW | {"enlarge"} and not is_any

    def draw(self, drawing: Drawing) -> bool:
        """Draw it. False: there is no room or no vessel for it, and the drawing is spoilt."""
        is_new = self.kind in _NEW or self.subject in drawing.nodes
        try:
            return is_new and _DRAW[self.kind](drawing, self)
        except NotDrawnError:
            return False


def _add_flask(drawing: Drawing, change: DrawableChange) -> bool:
    """Draw a flask of a reagent, or an empty one that gives back what it is given.

    Where no port is free, a reagent takes the place of one that the recipe does not use.
    """
    name = change.subject
    port = drawing.vacant_port()
    idle = drawing.idle_flask() if name and port is None else None
    if idle is not None:
        return _swap_flask(drawing, idle, name)
    port = port or drawing.free_port()
    if port is None:
        return False
    fields = {"type": "flask", "chemical": name, "max_volume": FIRST_ML, "current_volume": 0}
    key = drawing.add(f"flask_{name}" if name else "flask_buffer", "ChemputerFlask", **fields)
    drawing.lay(DrawnPort(key, "0"), port, both=not name)
    what = f"for {name}" if name else "that stays empty"

    def text() -> str:
        return f"Add flask {key}{drawing.size(key)} {what} at {_places(drawing, key)}"

    drawing.say("add_flask", text, key)
    return True


def _swap_flask(drawing: Drawing, key: str, name: str) -> bool:
    before = drawing.nodes[key].get("chemical")
    drawing.alter(key, chemical=name, current_volume=0)
    drawing.added.add(key)
    drawing.cost += 2
    text = (
        f"Put {name} into {key} in the place of {before}, which the recipe does not use; "
        "clean the flask and its tube first"
    )
    drawing.say("swap_flask", lambda: text, key)
    return True


def _add_vessel(drawing: Drawing, change: DrawableChange) -> bool:
    sort = VesselSort(str(change.value))
    class_, type_ = _CLASSES[sort]
    port = drawing.free_port()
    if port is None:
        return False
    fields: dict[str, object] = {"type": type_, "max_volume": FIRST_ML, "current_volume": 0}
    if sort is VesselSort.FLASK:
        fields["chemical"] = ""
    key = drawing.add(change.subject, class_, **fields)
    if not _join_vessel(drawing, sort, key, port):
        return False
    parts = drawing.parts(key)

    def text() -> str:
        told = f"Add {sort} {key}{drawing.size(key)} at {_places(drawing, key)}"
        behind = (f"{part}{drawing.size(part)} at {_places(drawing, part)}" for part in parts[:1])
        return told + "".join(f", with {one} behind its condenser" for one in behind)

    drawing.say("add_vessel", text, key, *parts)
    return True


def _join_vessel(drawing: Drawing, sort: VesselSort, key: str, port: DrawnPort) -> bool:
    if sort is VesselSort.WASTE:
        drawing.lay(port, DrawnPort(key, "0"))
    elif sort in _TWO_WAY:
        drawing.lay(DrawnPort(key, _TWO_WAY[sort]), port, both=True)
    else:
        is_filter = sort is VesselSort.FILTER
        drawing.lay(port, DrawnPort(key, "top" if is_filter else "evaporate"), both=not is_filter)
        other = drawing.free_port()
        if other is None:
            return False
        drawing.lay(DrawnPort(key, "bottom" if is_filter else "collect"), other)
    return True


def _places(drawing: Drawing, key: str) -> str:
    """Return the ports of other elements that tubes join a node to, for a sentence."""
    found = []
    for tube in drawing.rig().tubes:
        if tube.medium is not Medium.LIQUID:
            continue
        if tube.source == key and tube.target_port:
            found.append(f"{DrawnPort(tube.target, tube.target_port)} ({tube.source_port})")
        elif tube.target == key and tube.source_port:
            found.append(f"{DrawnPort(tube.source, tube.source_port)} ({tube.target_port})")
    return " and ".join(sorted(set(found)))


def _enlarge(drawing: Drawing, change: DrawableChange) -> bool:
    """Give a vessel the smallest common size that holds what comes into it."""
    key, size_ml = change.subject, size_for(change.amount)
    if size_ml is None:
        return False
    before = drawing.nodes[key].get("max_volume")
    drawing.alter(key, max_volume=size_ml)
    if key not in drawing.added:
        drawing.cost += 1
        text = f"Exchange {key}, which holds {before} mL, for one of {size_ml} mL"
        drawing.say("enlarge", lambda: text)
    return True


def _attach(drawing: Drawing, change: DrawableChange) -> bool:
    what, vessel = str(change.value), change.subject
    key = drawing.add(f"{what.replace(' ', '_')}_{vessel}", ATTACHED[what], type=what)
    drawing.attach(key, vessel)
    drawing.say("attach", lambda: f"Join {_article(what)} ({key}) to {vessel}", key)
    return True


def _attach_condenser(drawing: Drawing, change: DrawableChange) -> bool:
    vessel, target = change.subject, str(change.value)
    key = drawing.add(f"condenser_{vessel}", ATTACHED["condenser"], type="condenser")
    drawing.attach(key, vessel)
    drawing.attach(key, target)
    text = f"Join a condenser ({key}) that leads from {vessel} to {target}"
    drawing.say("attach", lambda: text, key)
    return True


def _attach_sensor(drawing: Drawing, change: DrawableChange) -> bool:
    quantity, vessel = str(change.value), change.subject
    key = drawing.add(f"sensor_{quantity}_{vessel}", f"{quantity}Sensor", type="sensor")
    drawing.attach(key, vessel)
    text = f"Join a sensor of the {quantity} ({key}) to {vessel}"
    drawing.say("attach", lambda: text, key)
    return True


def _article(what: str) -> str:
    return f"{'an' if what[0] in 'aeiou' else 'a'} {what}"


_THERMOSTATS = (
    ("circulator", "JULABOCF41", -40.0, 100.0),
    ("hotplate", "IKARCTDigital", 18.0, 360.0),
)
"""What a thermostat is drawn as, and what such a class reaches (`on_rig.equipment`)."""


def _attach_thermostat(drawing: Drawing, change: DrawableChange) -> bool:
    """Draw one thermostat that reaches all temperatures, else one for warm and one for cold."""
    degrees = change.degrees
    is_one = any(low <= degrees[0] and degrees[-1] <= high for *_, low, high in _THERMOSTATS)
    cold = () if is_one else tuple(c for c in degrees if c < _ROOM_C)
    for part in (cold, tuple(c for c in degrees if c not in cold)):
        if part:
            _attach_one(drawing, change.subject, part)
    return True


def _attach_one(drawing: Drawing, vessel: str, degrees: tuple[float, ...]) -> None:
    low_c, high_c = degrees[0], degrees[-1]
    fields: dict[str, object] = {"type": "heater"}
    known = [
        (what, class_)
        for what, class_, low, high in reversed(_THERMOSTATS)
        if low <= low_c and high_c <= high
    ]
    what, class_ = known[0] if known else ("thermostat", "heater_chiller")
    if not known:
        fields |= {"min_temp": min(low_c, _ROOM_C), "max_temp": max(high_c, _ROOM_C)}
    key = drawing.add(f"{what}_{vessel}", class_, **fields)
    drawing.attach(key, vessel)
    reach = f"{low_c:g} °C" if low_c == high_c else f"{low_c:g} to {high_c:g} °C"
    text = f"Join a {what} ({key}) that reaches {reach} to {vessel}"
    drawing.say("attach", lambda: text, key)


def _join_gas(drawing: Drawing, change: DrawableChange) -> bool:
    equipment = Equipment(drawing.rig())
    gases = {str(change.value)} if change.value else INERT
    wanted = max(gases)
    source = next((k for k in sorted(equipment.elements) if equipment.gas(k) in gases), None)
    is_new = source is None
    if source is None:
        fields = {"type": "flask", "chemical": wanted}
        source = drawing.add(f"flask_{wanted}", "ChemputerFlask", **fields)
    port = _gas_port(drawing, change.subject)
    if port is None:
        return False
    drawing.lay_gas(DrawnPort(source, "0"), port)
    text = f"Lead {wanted if is_new else equipment.gas(source)} from {source} to {port}"
    drawing.say("join_gas", lambda: text, source if is_new else "")
    return True


def _join_vacuum(drawing: Drawing, change: DrawableChange) -> bool:
    """Draw a vacuum line to a vessel: with a pump of its own, or from a line that is there."""
    vessel, equipment = change.subject, Equipment(drawing.rig())
    is_rotavap = equipment.sort(vessel) is VesselSort.ROTAVAP
    lines = drawing.vacuum_lines()
    if is_rotavap:
        if change.value != "own" and lines:
            return False
        pump = drawing.add(f"vacuum_pump_{vessel}", "CVC3000", type="vacuum")
        drawing.attach(pump, vessel)
        drawing.say("join_vacuum", lambda: f"Join vacuum pump {pump} to {vessel}", pump)
        return True
    if change.value == "own" or not lines:
        adds = drawing.new_vacuum(vessel)
        line, what = adds[-1], f"vacuum pump {adds[0]}"
    else:
        line, what, adds = lines[0], f"vacuum from {lines[0]}", ()
    port = _gas_port(drawing, vessel)
    if port is None:
        return False
    drawing.lay_gas(port, DrawnPort(line, "0"))
    drawing.say("join_vacuum", lambda: f"Lead {what} to {port}", *adds)
    return True


def _own_vacuum(drawing: Drawing, change: DrawableChange) -> bool:
    """Give a vessel that shares a vacuum pump one of its own."""
    vessel, pump = change.subject, str(change.value)
    if not drawing.detach(pump, vessel):
        return False
    key = drawing.add(f"vacuum_pump_{vessel}", "CVC3000", type="vacuum")
    drawing.attach(key, vessel)
    text = f"Take {vessel} off {pump} and give it a vacuum pump of its own ({key})"
    drawing.say("own_vacuum", lambda: text, key)
    return True


def _gas_port(drawing: Drawing, vessel: str) -> DrawnPort | None:
    """Return a free port of the valve for gas at a vessel, which is added where there is none."""
    rig, backbone = drawing.rig(), set(drawing.backbone())
    common = {element.key: element.common_port for element in rig.elements}
    for tube in rig.tubes:
        for own, far, port in (
            (tube.source, tube.target, tube.target_port),
            (tube.target, tube.source, tube.source_port),
        ):
            if own == vessel and port and port == common[far] and far not in backbone:
                found = drawing.vacant_port(far)
                if found is not None:
                    return found
    place = drawing.gas_place(vessel)
    if place is None:
        return None
    valve = drawing.add(f"valve_gas_{vessel}", "ChemputerValve", type="valve")
    drawing.lay_gas(DrawnPort(valve, drawing.common), place, both=True)
    text = f"Add valve {valve} for gas and vacuum, with its common port at {place}"
    drawing.say("add_valve", lambda: text, valve)
    return DrawnPort(valve, drawing.valve_ports(valve)[0])


def _add_receiver(drawing: Drawing, change: DrawableChange) -> bool:
    """Draw the flask that vapour condenses in, with a tube to drain it."""
    vessel = change.subject
    key = drawing.add_receiver(vessel)
    port = drawing.free_port()
    if port is None:
        return False
    drawing.lay(DrawnPort(key, "0"), port, both=True)

    def text() -> str:
        where = f"behind the condenser of {vessel}, with a tube to {port}"
        return f"Add flask {key}{drawing.size(key)} {where}"

    drawing.say("add_receiver", text, key)
    return True


def _join(drawing: Drawing, change: DrawableChange) -> bool:
    """Lay a tube between a vessel and the backbone, out of it or into it."""
    vessel, equipment, port = change.subject, Equipment(drawing.rig()), drawing.free_port()
    element = equipment.elements[vessel]
    name = element.leave_by if change.value == "out" else element.enter_by
    place = DrawnPort(vessel, name) if name is not None else drawing.free_port_of(vessel)
    if port is None or place is None:
        return False
    ends = (place, port) if change.value == "out" else (port, place)
    drawing.lay(*ends)
    drawing.cost += 1
    drawing.say("lay_tube", lambda: f"Lay a tube from {ends[0]} to {ends[1]}")
    return True


_DRAW: dict[str, Callable[[Drawing, DrawableChange], bool]] = {
    "add_flask": _add_flask,
    "add_vessel": _add_vessel,
    "add_waste": lambda drawing, change: add_waste(drawing, change.streams),
    "enlarge": _enlarge,
    "attach": _attach,
    "attach_sensor": _attach_sensor,
    "attach_condenser": _attach_condenser,
    "attach_thermostat": _attach_thermostat,
    "join_gas": _join_gas,
    "join_vacuum": _join_vacuum,
    "own_vacuum": _own_vacuum,
    "add_receiver": _add_receiver,
    "add_cartridge": lambda drawing, change: add_cartridge(drawing, change.subject),
    "move_cartridge": lambda drawing, change: move_cartridge(drawing, change.subject),
    "join": _join,
}
