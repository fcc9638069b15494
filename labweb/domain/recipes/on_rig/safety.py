"""What a plan has to leave behind: everything off, nothing evacuated."""

from __future__ import annotations

from labweb.domain.recipes.on_rig.making import Making
from labweb.domain.recipes.on_rig.steps import conditions, gases, instruments
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicKind, BasicOperation

_STOPS = {
    "light": (BasicKind.STOP_LIGHT, conditions.stop_light),
    "sonicate": (BasicKind.STOP_ULTRASOUND, instruments.stop_ultrasound),
    "heat": (BasicKind.STOP_TEMPERATURE, conditions.stop_temperature),
    "vacuum": (BasicKind.STOP_VACUUM, gases.stop_vacuum),
    "gas": (BasicKind.STOP_GAS, gases.stop_gas),
    "lower": (BasicKind.RAISE_FLASK, conditions.raise_flask),
    "rotate": (BasicKind.STOP_ROTATION, conditions.stop_rotation),
    "stir": (BasicKind.STOP_STIR, conditions.stop_stir),
}
"""What stops each sort of what runs: heat and vacuum before what keeps liquid moving."""


def shut_down(making: Making) -> None:
    """Stop what still runs, and vent what is evacuated."""
    names = {key: name for name, key in making.binding.vessels.items()}
    with making.naming("Shutdown"):
        for sort, (kind, stop) in _STOPS.items():
            for _, vessel in sorted(entry for entry in making.running if entry[0] == sort):
                fields = {"vessel": names.get(vessel, vessel)}
                stop(making, BasicOperation(kind=kind, fields=fields))
