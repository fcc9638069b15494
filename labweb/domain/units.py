"""Quantities at the border: text with a unit in, a bare number in a canonical unit out.

The canonical unit of each dimension is the one whose suffix our field names carry.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from functools import cache
from typing import TYPE_CHECKING, Any

from labweb.domain.dimensions import DIMENSIONS, Dimension
from labweb.domain.errors import UnitError

if TYPE_CHECKING:
    import pint

_QUANTITY = re.compile(r"^([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(\S.*)$")
_COMMA = re.compile(r"[0-9],[0-9]")
_LONGEST_TEXT = 64
_MOST_EXPONENT = 15


@cache
def _registry() -> pint.UnitRegistry[Any]:
    # A process that converts nothing, as most of an edge host do not, starts in half the time.
    import pint  # noqa: PLC0415

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
    number, written = _split(text, wanted)
    unit = wanted.spellings.get(written, written)
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
    return _whole(text, "volume", "nanolitre")


def parse_mass_ug(text: object) -> int:
    """Read a mass as whole micrograms; raises as `parse_volume_nl` does."""
    return _whole(text, "mass", "microgram")


def _whole(text: object, dimension: str, grid: str) -> int:
    amount = parse_exact(text, dimension) * 1000
    if amount <= 0:
        raise UnitError(f"{text!r} is not a positive {dimension}", code="unit.not_positive")
    if amount != amount.to_integral_value():
        raise UnitError(f"{text!r} is finer than one {grid}", code="unit.off_grid")
    return int(amount)


def _split(text: object, wanted: Dimension) -> tuple[Decimal, str]:
    if not isinstance(text, str) or not text.strip() or len(text) > _LONGEST_TEXT:
        example = f"5 {next(iter(wanted.units))}"
        raise UnitError(
            f"a {wanted.name} is written as number and unit, such as {example!r}; got {text!r}",
            code="unit.not_text",
        )
    stripped = text.strip().replace("\u2009", " ").replace("\u2212", "-")
    if _COMMA.search(stripped):
        raise UnitError(f"{text!r}: write a decimal point, not a comma", code="unit.comma")
    match = _QUANTITY.match(stripped)
    if match is None:
        raise UnitError(
            f"{text!r} is no {wanted.name}: write number and unit, such as "
            f"'5 {next(iter(wanted.units))}'",
            code="unit.unreadable",
        )
    return _number(match.group(1), text), match.group(2).strip()


def _number(digits: str, text: object) -> Decimal:
    """Return the number that digits write, unless it is beyond any laboratory."""
    beyond = UnitError(f"{text!r} is out of any laboratory's range", code="unit.not_finite")
    try:
        number = Decimal(digits)
    except InvalidOperation as error:  # an exponent that nothing can be computed with
        raise beyond from error
    if abs(number.adjusted()) > _MOST_EXPONENT:
        raise beyond
    return number


@dataclass(frozen=True, slots=True)
class Notation:
    """How one language writes one kind of quantity, beside a person's own way in `DIMENSIONS`."""

    name: str
    """What is measured, in words: `volume`, `molar mass`."""

    standard: str
    """pint unit of the number that is read."""

    units: Mapping[str, str]
    """Accepted spelling, with `u` for micro → pint unit; the first one is shown in examples."""

    words: Mapping[str, str] = field(default_factory=dict)
    """Words that stand for a value that no number gives, in small letters → their one name."""

    has_bare_numbers: bool = False
    """A number without a unit is in the standard unit."""

    most: Decimal = Decimal(10) ** 9
    """Largest number that is read, in the standard unit."""

    least: Decimal = Decimal(0)
    """Smallest number that is read, in the standard unit."""


@dataclass(frozen=True, slots=True)
class QuantityReading:
    """A quantity as a text gives it: one number, a range, or a word."""

    low: Decimal | None = None
    """Lower end, or the number itself, in the standard unit of the notation."""

    high: Decimal | None = None
    """Upper end; equal to `low` unless the text gives a range."""

    word: str = ""
    """Name of a word such as `all` or `reflux`; then there is no number."""

    @property
    def is_range(self) -> bool:
        """Tell whether the text leaves open which value it means."""
        return self.low != self.high

    @property
    def exact(self) -> Decimal | None:
        """Return the one number the text gives; None for a range and for a word."""
        return None if self.is_range else self.low


def read_quantity(text: object, notation: Notation) -> QuantityReading:
    """Read a quantity as a language writes it. Nothing is guessed, rounded or clamped.

    Args:
        text: Number and unit, a range of two numbers, or one of the notation's words.
            Micro, minus and degree are read in every way in which Unicode writes them.
        notation: What the language allows.

    Raises:
        UnitError: As `parse_exact`, and a number without its unit, an amount that is none
            (`two drops`, `ca. 5 mL`), a number below the least or above the most, or a
            range whose ends stand in the wrong order.

    Example:
        >>> time = Notation("time", "second", {"h": "hour", "min": "minute"})
        >>> read_quantity("1.5 h", time).exact
        Decimal('5400')
    """
    if not isinstance(text, str) or not text.strip() or len(text) > _LONGEST_TEXT:
        raise _unreadable(text, notation, "unit.not_text")
    plain = _plain_text(text)
    if plain.lower() in notation.words:
        return QuantityReading(word=notation.words[plain.lower()])
    if _COMMA.search(plain):
        raise UnitError(f"{text!r}: write a decimal point, not a comma", code="unit.comma")
    if _VAGUE.search(plain.lower()):
        raise UnitError(
            f"{text!r} says no amount that can be measured: {_example(notation)}",
            code="unit.vague",
        )
    one, ends = _SIGNED.match(plain), _RANGE.match(plain)
    if ends is None or (one is not None and (not one["unit"] or one["unit"] in notation.units)):
        value = _value_of(plain, text, notation, "")
        return QuantityReading(low=value, high=value)
    unit = (ends["unit"] or "").strip()
    low = _value_of(ends["low"], text, notation, unit)
    high = _value_of(f"{ends['high']} {unit}", text, notation, "")
    if low >= high:
        raise UnitError(f"{text!r}: a range goes from low to high", code="unit.range_order")
    return QuantityReading(low=low, high=high)


_MINUS = "\u2212\u2013\ufe63\uff0d"
_VAGUE = re.compile(
    r"\b(?:drops?|drop-?wise|pinch(?:es)?|few|some|several|spatula\w*|portions?|trace|excess|catalytic"
    r"|ca|circa|about|approx\w*|minimal|little)\b|[~\u2248\u00b1<>\u2264\u2265]|\+/-"
)
_SIGNED = re.compile(
    r"^(?P<number>[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(?P<unit>.*)$"
)
_RANGE = re.compile(
    r"^(?P<low>[+-]?[0-9]*\.?[0-9]+[^0-9]*?)\s*(?:-|\bto\b)\s*"
    r"(?P<high>[+-]?[0-9]*\.?[0-9]+)\s*(?P<unit>[^0-9].*)?$"
)
_SAME_SIGN = str.maketrans(
    dict.fromkeys(_MINUS, "-")
    | dict.fromkeys("\u00b5\u03bc", "u")
    | dict.fromkeys("\u2009\u202f\u00a0\u2007", " ")
    | dict.fromkeys("\u00ba\u02da", "°")
    | {"\u2103": "°C", "\u2109": "°F", "\u212a": "K", "\u00b7": " ", "\u22c5": " "}
    | {"\u207b": "-", "\u00b9": "1", "\u00b3": "3", "\u00b2": "2"}
)
_DIGITS = 24
"""Significant digits that a conversion keeps; pint works with 28."""


def _plain_text(text: str) -> str:
    return " ".join(text.translate(_SAME_SIGN).split())


def _value_of(plain: str, text: str, notation: Notation, default_unit: str) -> Decimal:
    match = _SIGNED.match(plain.strip())
    if match is None:
        raise _unreadable(text, notation, "unit.unreadable")
    number = _number(match["number"], text)
    unit = _unit_of(match["unit"].strip() or default_unit, text, notation)
    factor, offset = _scale(unit, notation.standard)
    value = _rounded(number * factor + offset)
    if value < notation.least:
        raise UnitError(
            f"{text!r} is below {notation.least} {notation.standard}", code="unit.out_of_range"
        )
    if value > notation.most:
        raise UnitError(f"{text!r} is more than any laboratory handles", code="unit.too_large")
    return value


def _unit_of(spelling: str, text: str, notation: Notation) -> str:
    if not spelling:
        if notation.has_bare_numbers:
            return notation.standard
        raise UnitError(f"{text!r} has no unit: {_example(notation)}", code="unit.missing")
    if spelling not in notation.units:
        known = ", ".join(list(notation.units)[:8]) or "no unit"
        raise UnitError(
            f"{text!r} is not a {notation.name}: it is written in {known}", code="unit.unknown"
        )
    return notation.units[spelling]


def _rounded(value: Decimal) -> Decimal:
    """Drop what the limited precision of a conversion left behind, such as 25.0000…01."""
    if not value:
        return Decimal(0)
    digits = value.adjusted() - _DIGITS + 1
    whole = value.quantize(Decimal(1).scaleb(digits)).normalize()
    return whole.quantize(Decimal(1)) if whole == whole.to_integral_value() else whole


def _example(notation: Notation) -> str:
    return f"write number and unit, such as '5 {next(iter(notation.units), '')}'"


def _unreadable(text: object, notation: Notation, code: str) -> UnitError:
    return UnitError(f"{text!r:.80} is no {notation.name}: {_example(notation)}", code=code)


def steady(rate: Decimal | float) -> float:
    """Return a rate on the grid of plans: nine significant digits, however slow it is.

    Example:
        >>> steady(Decimal("0.00002777777777")), steady(2000 / 3)
        (2.77777778e-05, 666.666667)
    """
    return float(f"{rate:.9g}")


def render_mass(amount_ug: int) -> str:
    """Write a mass for a person, in milligrams.

    Example:
        >>> render_mass(2_500)
        '2.5 mg'
    """
    return f"{amount_ug / 1000:g} mg"


def render_volume(amount_nl: int) -> str:
    """Write a volume for a person, in millilitres.

    Example:
        >>> render_volume(5_000_000)
        '5.00 mL'
    """
    return f"{amount_nl / 1_000_000:.2f} mL"
