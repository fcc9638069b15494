"""Quantities at the border: text with a unit in, a bare number in a canonical unit out.

The canonical unit of each dimension is the one whose suffix our field names carry.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from typing import Any

import pint

from labweb.domain.errors import UnitError

_QUANTITY = re.compile(r"^([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*)$")
_LONGEST_TEXT = 64


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
            "mass",
            "mg",
            "milligram",
            {"g": "gram", "mg": "milligram", "kg": "kilogram", "ug": "microgram"}
            | {"\u00b5g": "microgram", "\u03bcg": "microgram"},
            "10000 kg",
        ),
    )
}
"""The closed list, by dimension."""


@cache
def _registry() -> pint.UnitRegistry[Any]:
    return pint.UnitRegistry(non_int_type=Decimal, autoconvert_offset_to_baseunit=True)


@cache
def _scale(unit: str, canonical: str) -> tuple[Decimal, Decimal]:
    """Return (factor, offset) such that canonical = value * factor + offset."""
    quantity = _registry().Quantity
    zero = Decimal(quantity(Decimal(0), unit).to(canonical).magnitude)
    one = Decimal(quantity(Decimal(1), unit).to(canonical).magnitude)
    return one - zero, zero


def parse_exact(text: object, dimension: str) -> Decimal:
    """Read a quantity such as `"5 mL"` and return it in the canonical unit.

    Args:
        text: What the person or file wrote: number, then unit.
        dimension: Name in `DIMENSIONS`.

    Raises:
        UnitError: Not text, no unit, a unit of another dimension, a decimal
            comma, not finite, too long, or beyond any laboratory. Nothing is guessed.

    Example:
        >>> parse_exact("250 uL", "volume")
        Decimal('250')
        >>> parse_exact("-78 °C", "temperature")
        Decimal('-78')
    """
    wanted = DIMENSIONS[dimension]
    number, unit = _split(text, wanted)
    if unit not in wanted.units:
        known = ", ".join(wanted.units)
        raise UnitError(f"{text!r} is not a {dimension}: use one of {known}", code="unit.unknown")
    factor, offset = _scale(wanted.units[unit], wanted.canonical)
    value = number * factor + offset
    if value > _most(wanted.name):
        raise UnitError(
            f"{text!r} is more than any laboratory handles: at most {wanted.most} is read",
            code="unit.too_large",
        )
    return value


@cache
def _most(dimension: str) -> Decimal:
    wanted = DIMENSIONS[dimension]
    number, unit = _split(wanted.most, wanted)
    factor, offset = _scale(wanted.units[unit], wanted.canonical)
    return number * factor + offset


def parse(text: object, dimension: str) -> float:
    """Read a quantity and return it in the canonical unit as a float.

    Raises:
        UnitError: As `parse_exact`.
    """
    value = float(parse_exact(text, dimension))
    if not math.isfinite(value):
        raise UnitError(f"{text!r} is not a finite {dimension}", code="unit.not_finite")
    return value


def parse_volume_nl(text: object) -> int:
    """Read a volume as whole nanolitres; off the grid is refused, never rounded.

    Raises:
        UnitError: As `parse_exact`, or the volume is no whole number of nanolitres,
            or is not positive.
    """
    amount = parse_exact(text, "volume") * 1000
    if amount <= 0:
        raise UnitError(f"{text!r} is not a positive volume", code="unit.not_positive")
    if amount != amount.to_integral_value():
        raise UnitError(f"{text!r} is finer than one nanolitre", code="unit.off_grid")
    return int(amount)


def _split(text: object, wanted: Dimension) -> tuple[Decimal, str]:
    if not isinstance(text, str) or not text.strip() or len(text) > _LONGEST_TEXT:
        example = f"5 {next(iter(wanted.units))}"
        raise UnitError(
            f"a {wanted.name} is written as number and unit, such as {example!r}; got {text!r}",
            code="unit.not_text",
        )
    stripped = text.strip().replace("\u2009", " ").replace("\u2212", "-")
    if re.match(r"^[+-]?\d+,\d", stripped):
        raise UnitError(f"{text!r}: write a decimal point, not a comma", code="unit.comma")
    match = _QUANTITY.match(stripped)
    if match is None:
        raise UnitError(
            f"{text!r} is no {wanted.name}: write number and unit, such as "
            f"'5 {next(iter(wanted.units))}'",
            code="unit.unreadable",
        )
    number = Decimal(match.group(1))
    if abs(number.adjusted()) > 15:
        raise UnitError(f"{text!r} is out of any laboratory's range", code="unit.not_finite")
    return number, match.group(2).strip()


def render_volume(amount_nl: int) -> str:
    """Write a volume for a person, in millilitres.

    Example:
        >>> render_volume(5_000_000)
        '5.00 mL'
    """
    return f"{amount_nl / 1_000_000:.2f} mL"
