"""The kinds of quantity, and the units a person may write each in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Dimension:
    """One kind of quantity and the units a person may write it in."""

    name: str
    """Name as used in schemas (`x-quantity`)."""

    suffix: str
    """Suffix of our field names."""

    canonical: str
    """pint unit of the stored number."""

    units: Mapping[str, str]
    """Accepted spelling → pint unit; the first one is shown by default."""

    most: str
    """Largest quantity that is read: far above what any laboratory handles."""

    spellings: Mapping[str, str] = field(default_factory=dict)
    """Another spelling → the unit that it means, one of `units`."""


_MICRO = {
    f"{micro}{liter}": "microliter" for liter in ("L", "l") for micro in ("u", "\u00b5", "\u03bc")
}
"""The micro sign and the Greek letter look alike: both are read as `u` is."""


def _spelled(**units: str) -> dict[str, str]:
    return {spelling: unit for unit, text in units.items() for spelling in text.split()}


_LITRES = _spelled(
    mL="cm3 cc millilitre millilitres milliliter milliliters",
    L="litre litres liter liters",
    cL="cl centilitre centilitres centiliter centiliters",
    dL="dl decilitre decilitres deciliter deciliters",
    uL="microlitre microlitres microliter microliters",
)
_FLOWS = {
    f"{litre}{per}": f"{unit}/{time}"
    for litre, unit in {
        **{"mL": "mL", "ml": "mL", "cm3": "mL", "cc": "mL"},
        **{"L": "L", "l": "L", "dm3": "L", "uL": "uL", "ul": "uL"},
    }.items()
    for time in ("min", "s", "h")
    for per in (f"/{time}", f" {time}-1")
}

DIMENSIONS: Mapping[str, Dimension] = {
    dimension.name: dimension
    for dimension in (
        Dimension(
            "volume",
            "ul",
            "microliter",
            {"mL": "milliliter", "ml": "milliliter", **_MICRO}
            | {"L": "liter", "l": "liter", "nL": "nanoliter", "nl": "nanoliter"}
            | {"cL": "centiliter", "dL": "deciliter"},
            "10000 L",
            _LITRES,
        ),
        Dimension(
            "flow_rate",
            "ul_s",
            "microliter/second",
            {"mL/min": "milliliter/minute", "ml/min": "milliliter/minute"}
            | {f"{unit}/s": "microliter/second" for unit in _MICRO}
            | {"mL/s": "milliliter/second"}
            | {f"{unit}/min": "microliter/minute" for unit in _MICRO}
            | {"uL/h": "microliter/hour", "mL/h": "milliliter/hour", "L/h": "liter/hour"}
            | {"L/min": "liter/minute", "L/s": "liter/second"},
            "1000000 mL/s",
            _FLOWS,
        ),
        Dimension(
            "temperature",
            "c",
            "degC",
            {"°C": "degC", "degC": "degC", "C": "degC", "K": "kelvin", "°F": "degF"},
            "10000 °C",
            dict.fromkeys(("deg C", "° C", "degrees C", "celsius", "Celsius"), "°C")
            | {"kelvin": "K", "F": "°F", "degF": "°F", "fahrenheit": "°F"},
        ),
        Dimension(
            "temperature_difference", "delta_c", "delta_degC", {"K": "delta_degC"}, "10000 K"
        ),
        Dimension(
            "time",
            "s",
            "second",
            {"min": "minute", "s": "second", "h": "hour", "ms": "millisecond", "day": "day"},
            "10000 h",
            _spelled(
                s="sec secs second seconds",
                min="mins minute minutes",
                h="hr hrs hour hours",
                day="days",
            ),
        ),
        Dimension(
            "speed",
            "rpm",
            "revolutions_per_minute",
            {"rpm": "revolutions_per_minute"},
            "1000000 rpm",
            {"RPM": "rpm"},
        ),
        Dimension(
            "pressure",
            "kpa",
            "kilopascal",
            {"mbar": "millibar", "kPa": "kilopascal", "bar": "bar", "Torr": "torr"}
            | {"atm": "standard_atmosphere", "Pa": "pascal", "hPa": "hectopascal"}
            | {"MPa": "megapascal"},
            "100000 kPa",
            {"torr": "Torr", "mmHg": "Torr", "mmhg": "Torr", "pa": "Pa", "pascal": "Pa"},
        ),
        Dimension(
            "mass",
            "mg",
            "milligram",
            {"g": "gram", "mg": "milligram", "kg": "kilogram", "ug": "microgram"}
            | {"\u00b5g": "microgram", "\u03bcg": "microgram"},
            "10000 kg",
            _spelled(
                g="gram grams",
                kg="kilogram kilograms",
                mg="milligram milligrams",
                ug="microgram micrograms",
            ),
        ),
        Dimension("ph_difference", "ph", "dimensionless", {"pH": "dimensionless"}, "14 pH"),
        Dimension("share", "ratio", "dimensionless", {"%": "percent"}, "100 %"),
    )
}
"""The closed list, by dimension."""
