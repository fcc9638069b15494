"""The kinds of quantity, and the units a person may write each in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


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


_MICRO = {
    f"{micro}{liter}": "microliter" for liter in ("L", "l") for micro in ("u", "\u00b5", "\u03bc")
}
"""The micro sign and the Greek letter look alike: both are read as `u` is."""

DIMENSIONS: Mapping[str, Dimension] = {
    dimension.name: dimension
    for dimension in (
        Dimension(
            "volume",
            "ul",
            "microliter",
            {"mL": "milliliter", "ml": "milliliter", **_MICRO}
            | {"L": "liter", "l": "liter", "nL": "nanoliter", "nl": "nanoliter"},
            "10000 L",
        ),
        Dimension(
            "flow_rate",
            "ul_s",
            "microliter/second",
            {"mL/min": "milliliter/minute", "ml/min": "milliliter/minute"}
            | {f"{unit}/s": "microliter/second" for unit in _MICRO}
            | {"mL/s": "milliliter/second"}
            | {f"{unit}/min": "microliter/minute" for unit in _MICRO},
            "1000000 mL/s",
        ),
        Dimension(
            "temperature",
            "c",
            "degC",
            {"°C": "degC", "degC": "degC", "C": "degC", "K": "kelvin"},
            "10000 °C",
        ),
        Dimension(
            "temperature_difference", "delta_c", "delta_degC", {"K": "delta_degC"}, "10000 K"
        ),
        Dimension(
            "time",
            "s",
            "second",
            {"min": "minute", "s": "second", "h": "hour", "ms": "millisecond"},
            "10000 h",
        ),
        Dimension(
            "speed",
            "rpm",
            "revolutions_per_minute",
            {"rpm": "revolutions_per_minute"},
            "1000000 rpm",
        ),
        Dimension(
            "pressure", "kpa", "kilopascal", {"mbar": "millibar", "kPa": "kilopascal"}, "100000 kPa"
        ),
        Dimension(
            "mass",
            "mg",
            "milligram",
            {"g": "gram", "mg": "milligram", "kg": "kilogram", "ug": "microgram"}
            | {"\u00b5g": "microgram", "\u03bcg": "microgram"},
            "10000 kg",
        ),
        Dimension("ph_difference", "ph", "dimensionless", {"pH": "dimensionless"}, "14 pH"),
        Dimension("share", "ratio", "dimensionless", {"%": "percent"}, "100 %"),
    )
}
"""The closed list, by dimension."""
