"""What labweb takes where a recipe says nothing: the one table, with the source of each value.

A value from here is never silent: the operation that takes it says so. Where this table has
nothing, what is missing is a finding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Default:
    """One value, as text with its unit, and where it comes from."""

    value: str
    source: str


_CHEMPUTER = "defaults of the Chemputer platform (XDL 0.3 to 0.5)"
_LABWEB = "labweb"

DEFAULTS: Mapping[str, Default] = {
    "stir_speed": Default("250 RPM", _CHEMPUTER),
    "separation.solvent_volume": Default("30 mL", _CHEMPUTER),
    "separation.fast_stir_speed": Default("600 RPM", _CHEMPUTER),
    "separation.fast_stir_time": Default("5 min", _CHEMPUTER),
    "separation.slow_stir_speed": Default("30 RPM", _CHEMPUTER),
    "separation.slow_stir_time": Default("2 min", _CHEMPUTER),
    "separation.settling_time": Default("5 min", _CHEMPUTER),
    "filter.stir_speed": Default("500 RPM", _CHEMPUTER),
    "filter.vacuum_pressure": Default("400 mbar", _CHEMPUTER),
    "filter.vacuum_time": Default("2 min", _CHEMPUTER),
    "wash_solid.volume": Default("20 mL", _CHEMPUTER),
    "wash_solid.time": Default("30 s", _CHEMPUTER),
    "wash_solid.vacuum_time": Default("10 s", _CHEMPUTER),
    "dry.time": Default("1 h", _CHEMPUTER),
    "dry.pressure": Default("400 mbar", _CHEMPUTER),
    "dissolve.time": Default("20 min", _CHEMPUTER),
    "evacuate.repeats": Default("3", _CHEMPUTER),
    "evacuate.pressure": Default("50 mbar", _CHEMPUTER),
    "evacuate.vacuum_time": Default("1 min", _CHEMPUTER),
    "evacuate.gas_time": Default("1 min", _CHEMPUTER),
    "purge.time": Default("5 min", _CHEMPUTER),
    "rotavap.rotation_speed": Default("250 RPM", _CHEMPUTER),
    "rotavap.temperature": Default("25 °C", _CHEMPUTER),
    "prime.tube_volumes": Default(
        "2", _LABWEB + ": after one volume the front is still mixed with what was in the tube"
    ),
    "rinse.volume": Default("3 mL", _CHEMPUTER),
    "rinse.repeats": Default("1", _CHEMPUTER),
    "rinse.incompatible_repeats": Default(
        "3", _LABWEB + ": each rinse leaves about a tenth of what was there"
    ),
    "clean_vessel.repeats": Default("2", _CHEMPUTER),
    "clean_vessel.time": Default("1 min", _CHEMPUTER),
    "adjust_ph.mixing_time": Default("30 s", _LABWEB + ": a stirred flask of a litre is mixed"),
    "adjust_ph.tolerance": Default("0.1", _LABWEB + ": accuracy of common pH electrodes"),
    "repeat.most_rounds": Default(
        "20", _LABWEB + ": a loop that no reading has ended asks a person"
    ),
    "room_temperature": Default("25 °C", _LABWEB + ": middle of what a laboratory is kept at"),
    "overnight": Default("16 h", _LABWEB + ": from one working day to the next"),
    "temperature_tolerance": Default("1 °C", _LABWEB + ": resolution of common thermostats"),
}
"""Value by what it stands for."""
