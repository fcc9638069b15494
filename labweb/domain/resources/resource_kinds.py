"""The closed list of kinds, and what each can do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum


class Nature(StrEnum):
    """What a resource can do: act, hold, or both."""

    ACTION = "action"
    """It acts: a valve, a sensor."""

    RESOURCE = "resource"
    """It holds: a bottle, a bench."""

    ACTION_RESOURCE = "action_resource"
    """It does both: a syringe pump, a heater-stirrer with a vessel on it."""


@dataclass(frozen=True, slots=True)
class Kind:
    """One sort of resource."""

    name: str
    nature: Nature
    label: str
    """What a person calls it."""

    holds_liquid: bool = False
    """It is a Vessel: it has contents and a capacity."""

    is_place: bool = False
    """Other resources may stand in or on it."""

    conducts: bool = False
    """Liquid passes through it without being held: a valve."""


_A, _R, _AR = Nature.ACTION, Nature.RESOURCE, Nature.ACTION_RESOURCE

KINDS: Mapping[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("lab", _R, "Lab", is_place=True),
        Kind("site", _R, "Site", is_place=True),
        Kind("room", _R, "Room", is_place=True),
        Kind("bench", _R, "Bench", is_place=True),
        Kind("workstation", _AR, "Workstation", is_place=True),
        Kind("deck", _R, "Deck", is_place=True),
        Kind("slot", _R, "Slot", is_place=True),
        Kind("carrier", _R, "Carrier", is_place=True),
        Kind("storage", _R, "Storage", is_place=True),
        Kind("archive", _R, "Archive", is_place=True),
        Kind("plate", _R, "Plate", is_place=True),
        Kind("well", _R, "Well", holds_liquid=True),
        Kind("tip_rack", _R, "Tip rack", is_place=True),
        Kind("tip_spot", _R, "Tip spot", is_place=True),
        Kind("tip", _R, "Tip", holds_liquid=True),
        Kind("tube_rack", _R, "Tube rack", is_place=True),
        Kind("reservoir", _R, "Reservoir", is_place=True),
        Kind("trough", _R, "Trough", holds_liquid=True),
        Kind("tube", _R, "Tube", holds_liquid=True),
        Kind("bottle", _R, "Bottle", holds_liquid=True),
        Kind("flask", _R, "Flask", holds_liquid=True),
        Kind("vial", _R, "Vial", holds_liquid=True),
        Kind("vessel", _R, "Vessel", holds_liquid=True),
        Kind("reactor", _R, "Reactor", holds_liquid=True),
        Kind("separator", _R, "Separator", holds_liquid=True),
        Kind("filter", _R, "Filter", holds_liquid=True),
        Kind("waste", _R, "Waste", holds_liquid=True),
        Kind("cartridge", _R, "Cartridge"),
        Kind("lid", _R, "Lid"),
        Kind("syringe_pump", _AR, "Syringe pump", holds_liquid=True),
        Kind("pipette_channel", _AR, "Pipette channel", is_place=True),
        Kind("rotary_valve", _A, "Rotary valve", conducts=True),
        Kind("solenoid_valve", _A, "Solenoid valve", conducts=True),
        Kind("heater_stirrer", _AR, "Heater-stirrer", is_place=True),
        Kind("heater", _AR, "Heater", is_place=True),
        Kind("stirrer", _AR, "Stirrer", is_place=True),
        Kind("thermostat", _AR, "Thermostat", is_place=True),
        Kind("phase_separator", _AR, "Phase separator", is_place=True),
        Kind("rotary_evaporator", _AR, "Rotary evaporator", is_place=True),
        Kind("vacuum_controller", _A, "Vacuum controller"),
        Kind("vacuum_line", _R, "Vacuum line"),
        Kind("balance", _AR, "Balance", is_place=True),
        Kind("transmitter", _A, "Transmitter"),
        Kind("timer", _A, "Timer"),
        Kind("continuous_pump", _A, "Continuous pump", conducts=True),
        Kind("injection_valve", _AR, "Injection valve", is_place=True, conducts=True),
        Kind("sample_loop", _R, "Sample loop", holds_liquid=True),
        Kind("liquid_handler", _AR, "Liquid handler", is_place=True),
        Kind("powder_dispenser", _AR, "Powder dispenser", is_place=True),
        Kind("shaker", _AR, "Shaker", is_place=True),
        Kind("furnace", _AR, "Furnace", is_place=True),
        Kind("chromatography", _AR, "Chromatography system", is_place=True),
        Kind("analyser", _AR, "Analyser", is_place=True),
        Kind("plate_reader", _AR, "Plate reader", is_place=True),
        Kind("spectrometer", _AR, "Spectrometer", is_place=True),
        Kind("potentiostat", _A, "Potentiostat"),
        Kind("battery_tester", _AR, "Battery tester", is_place=True),
        Kind("power_supply", _A, "Power supply"),
        Kind("camera", _A, "Camera"),
        Kind("arm", _AR, "Arm", is_place=True),
        Kind("gripper", _AR, "Gripper", is_place=True),
        Kind("gantry", _AR, "Gantry", is_place=True),
        Kind("agv", _AR, "Vehicle", is_place=True),
        Kind("compute", _A, "Computer"),
        Kind("foreign", _R, "Foreign", is_place=True),
    )
}
"""Kind by name. A class that nobody mapped is `foreign`: kept, shown, not schedulable."""


VACUUMS = frozenset({"vacuum_controller", "vacuum_line"})
"""What draws vacuum, or leads to what does."""


def is_vessel(kind: str) -> bool:
    """Tell whether resources of this kind have contents."""
    found = KINDS.get(kind)
    return found is not None and found.holds_liquid
