"""How XDL writes quantities: spellings, standard units, and where a bare number counts.

Source:
    XDL standard, "Units"; spellings of published recipes. What a person may write of the same
    dimension is read here too; `m` is minutes here alone, for XDL has no metres of time to confuse
    it with.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal

from labweb.domain.dimensions import DIMENSIONS
from labweb.domain.units import Notation


def _read_of(dimension: str) -> dict[str, str]:
    """Return the spellings that a person may write, all that begin in ASCII: `u` is micro here."""
    known = DIMENSIONS[dimension]
    units = {name: unit for name, unit in known.units.items() if name[0] not in "\u00b5\u03bc"}
    return units | {name: known.units[unit] for name, unit in known.spellings.items()}


_MOLES = {
    spelling: unit
    for unit, spellings in {
        "mole": "mol mole moles",
        "millimole": "mmol millimole millimoles",
        "micromole": "umol micromole micromoles",
    }.items()
    for spelling in spellings.split()
}
_EQUIVALENTS = dict.fromkeys(
    ("eq", "eq.", "equiv", "equiv.", "equivs", "equivalent", "equivalents"), ""
)
_ROOM = dict.fromkeys(
    ("r.t.", "r.t", "rt", "room temperature", "room temp", "ambient"), "room_temperature"
)


def _per(top: Mapping[str, str], bottom: Mapping[str, str]) -> dict[str, str]:
    """Write every quotient of two units, `g/mL` and `g mL-1` alike."""
    return {
        written: f"{above} / ({below})"
        for a, above in top.items()
        for b, below in bottom.items()
        for written in (f"{a}/{b}", f"{a} {b}-1")
    }


_SHORT_GRAMS = {"g": "gram", "mg": "milligram", "ug": "microgram", "kg": "kilogram"}
_SHORT_LITRES = {
    **{"mL": "milliliter", "ml": "milliliter", "cm3": "milliliter", "cc": "milliliter"},
    **{"L": "liter", "l": "liter", "uL": "microliter", "ul": "microliter"},
    **{"dm3": "liter", "m3": "meter ** 3"},
}
_SHORT_MOLES = {"mol": "mole", "mmol": "millimole", "umol": "micromole"}

VOLUME = Notation(
    "volume", "milliliter", _read_of("volume"), has_bare_numbers=True, most=Decimal(10**7)
)
VOLUME_OR_ALL = replace(VOLUME, words={"all": "all"})
MASS = Notation("mass", "gram", _read_of("mass"), has_bare_numbers=True, most=Decimal(10**7))
AMOUNT_OF_SUBSTANCE = Notation(
    "amount of substance", "mole", _MOLES, has_bare_numbers=True, most=Decimal(10**6)
)
EQUIVALENTS = Notation("number of equivalents", "", _EQUIVALENTS, most=Decimal(10**5))
TEMPERATURE = Notation(
    "temperature",
    "degC",
    _read_of("temperature"),
    words=_ROOM | {"reflux": "reflux"},
    has_bare_numbers=True,
    least=Decimal("-273.15"),
    most=Decimal(5000),
)
TEMPERATURE_DIFFERENCE = Notation(
    "temperature difference",
    "delta_degC",
    {"°C": "delta_degC", "C": "delta_degC", "celsius": "delta_degC", "K": "delta_degC"}
    | {"F": "delta_degF", "°F": "delta_degF"},
    has_bare_numbers=True,
    most=Decimal(1000),
)
TIME = Notation(
    "time",
    "second",
    {**_read_of("time"), "m": "minute"},
    words={"overnight": "overnight"},
    has_bare_numbers=True,
    most=Decimal(10**8),
)
PRESSURE = Notation(
    "pressure",
    "millibar",
    _read_of("pressure"),
    has_bare_numbers=True,
    most=Decimal(10**6),
)
ROTATION = Notation(
    "stirring speed",
    "revolutions_per_minute",
    _read_of("speed"),
    has_bare_numbers=True,
    most=Decimal(10**6),
)
FLOW = Notation(
    "flow rate",
    "milliliter/minute",
    _read_of("flow_rate") | _per({"m3": "meter ** 3"}, {"min": "minute", "s": "second"}),
    has_bare_numbers=True,
    most=Decimal(10**7),
)
WAVELENGTH = Notation(
    "wavelength",
    "nanometer",
    {"nm": "nanometer", "um": "micrometer", "mm": "millimeter", "cm": "centimeter"}
    | {"m": "meter", "km": "kilometer"},
    has_bare_numbers=True,
    most=Decimal(10**13),
)
MOLAR_MASS = Notation(
    "molar mass",
    "gram / mole",
    _per(_SHORT_GRAMS, {"mol": "mole", "mmol": "millimole"}),
    has_bare_numbers=True,
    most=Decimal(10**8),
)
DENSITY = Notation(
    "density",
    "gram / milliliter",
    _per(_SHORT_GRAMS, _SHORT_LITRES),
    has_bare_numbers=True,
    most=Decimal(1000),
)
CONCENTRATION = Notation(
    "concentration",
    "mole / liter",
    _per(_SHORT_MOLES, _SHORT_LITRES)
    | {"M": "mole / liter", "mM": "millimole / liter", "uM": "micromole / liter"},
    has_bare_numbers=True,
    most=Decimal(1000),
)
MASS_FRACTION = Notation(
    "mass fraction",
    "percent",
    dict.fromkeys(("wt %", "wt%", "wt.%", "wt. %", "% w/w", "% (w/w)", "%wt", "% wt"), "percent"),
    most=Decimal(100),
)
PERCENT = Notation(
    "percentage", "percent", {"%": "percent"}, has_bare_numbers=True, most=Decimal(100)
)
PH = Notation("pH", "", {}, has_bare_numbers=True, least=Decimal(-2), most=Decimal(16))
POWER = Notation(
    "power", "watt", {"W": "watt", "mW": "milliwatt", "kW": "kilowatt"}, has_bare_numbers=True
)
RELATIVE_ACCELERATION = Notation(
    "relative acceleration",
    "",
    dict.fromkeys(("xg", "x g", "×g", "× g", "g"), ""),
    most=Decimal(10**7),
)

NOTATIONS: Mapping[str, Notation] = {
    "volume": VOLUME,
    "volume_or_all": VOLUME_OR_ALL,
    "mass": MASS,
    "moles": AMOUNT_OF_SUBSTANCE,
    "time": TIME,
    "temperature": TEMPERATURE,
    "temperature_difference": TEMPERATURE_DIFFERENCE,
    "pressure": PRESSURE,
    "rotation": ROTATION,
    "flow": FLOW,
    "wavelength": WAVELENGTH,
    "molar_mass": MOLAR_MASS,
    "density": DENSITY,
    "percent": PERCENT,
    "ph": PH,
    "power": POWER,
    "rcf": RELATIVE_ACCELERATION,
}
"""Notation of each sort of property that is one quantity."""

AMOUNTS: Mapping[str, Notation] = {
    "volume": replace(VOLUME, has_bare_numbers=False),
    "mass": replace(MASS, has_bare_numbers=False),
    "moles": replace(AMOUNT_OF_SUBSTANCE, has_bare_numbers=False),
    "equivalents": EQUIVALENTS,
}
"""What an `amount` may be; its unit says which."""

CONCENTRATIONS: Mapping[str, Notation] = {
    "concentration": CONCENTRATION,
    "mass_fraction": MASS_FRACTION,
}
"""What the `concentration` of a reagent may be."""
