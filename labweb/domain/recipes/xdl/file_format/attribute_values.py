"""The text of one attribute as a value: a quantity, a choice, a number, a name."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal

from labweb.domain.errors import UnitError
from labweb.domain.recipes.xdl.tables.notation_table import AMOUNTS, CONCENTRATIONS, MASS, NOTATIONS
from labweb.domain.recipes.xdl.tables.step_spec import Property
from labweb.domain.units import Notation, QuantityReading, read_quantity


@dataclass(frozen=True, slots=True)
class XdlQuantity:
    """A measured value: what is measured, and how much of it in XDL's standard unit."""

    sort: str
    """`volume` in mL, `mass` in g, `moles` in mol, `equivalents`, `time` in s, `temperature` in °C,
    `pressure` in mbar, `rotation` in RPM, `flow` in mL/min, `wavelength` in nm and so on."""

    reading: QuantityReading
    is_per_equivalent: bool = False
    """Scaled by the equivalents of a blueprint: `20 mg/eq`."""

    @property
    def exact(self) -> Decimal | None:
        """Return the one number, or None for a range and a word."""
        return self.reading.exact

    @property
    def word(self) -> str:
        """Return the name of a word such as `all`, "" for a number."""
        return self.reading.word


@dataclass(frozen=True, slots=True)
class ParameterName:
    """Stands for the value of a Parameter."""

    id: str


Value = XdlQuantity | ParameterName | bool | int | Decimal | str | tuple["Value", ...]

_TRUTH = {"true": True, "True": True, "false": False, "False": False}
_COUNT = re.compile(r"[0-9]{1,9}")
_NUMBER = re.compile(r"[+-]?(?:[0-9]{1,12}\.?[0-9]{0,12}|\.[0-9]{1,12})")
_FORMULA = re.compile(r"(?:[A-Z][a-z]?[0-9]*|[()\[\].·][0-9]*|[+-][0-9]*(?=$))+")
_PER_EQUIVALENT = re.compile(r"^(.*?)\s*/\s*(?:eq|equiv|equivalent)s?\.?$")
_STANDARDS: Mapping[str, Notation] = {**NOTATIONS, **AMOUNTS, **CONCENTRATIONS}
_NO_BRACKETS = str.maketrans("", "", "()")
_NAMES = frozenset({"vessel", "reagent", "text", "port", "through", "gas", "pid"})


def read_value(text: str, wanted: Property) -> Value:
    """Read the text of an attribute as what the attribute is.

    Raises:
        UnitError: It is not that; the code says why. Nothing is guessed.
    """
    if wanted.choices:
        return _choice(text, wanted.choices)
    if wanted.sort in _NAMES:
        if not text.strip():
            raise UnitError(f"{wanted.name} is empty", code="xdl.empty_value")
        return text
    if wanted.sort in NOTATIONS:
        plain = text.strip()
        text = plain.removeprefix("pH").strip() if wanted.sort == "ph" else text
        sort = wanted.sort.removesuffix("_or_all")
        return XdlQuantity(sort, read_quantity(text, NOTATIONS[wanted.sort]))
    return _READERS[wanted.sort](text)


def unit_of(sort: str) -> str:
    """Return the standard unit of a sort of value as a person writes it, "" when it has none."""
    notation = _STANDARDS.get(sort)
    if notation is None:
        return ""
    if not notation.standard:
        return next(iter(notation.units), "")
    plain = notation.standard.replace("(", "").replace(")", "")
    spellings = notation.units.items()
    return next(text for text, unit in spellings if unit.translate(_NO_BRACKETS) == plain)


def written(value: Value | None) -> str:
    """Return a value as a recipe may write it, in standard units; "" for none."""
    if isinstance(value, XdlQuantity):
        reading, unit = value.reading, unit_of(value.sort)
        if reading.word or reading.low is None or reading.high is None:
            return reading.word.replace("_", " ")
        ends = [reading.low, reading.high] if reading.is_range else [reading.low]
        number = "–".join(_plain(end) for end in ends)
        scaled = "/eq" if value.is_per_equivalent else ""
        return f"{number} {unit}".strip() + scaled
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Decimal):
        return _plain(value)
    return "" if value is None else str(value)


def _plain(number: Decimal) -> str:
    text = f"{number:f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def read_amount(text: str) -> XdlQuantity:
    """Read an amount whose unit says what is measured: `5 g`, `2 mmol`, `1.2 eq`, `3 mL/eq`.

    Raises:
        UnitError: As `labweb.domain.units.read_quantity`.
    """
    match = _PER_EQUIVALENT.match(text)
    if match and match[1].strip():
        found = _first(match[1], {k: v for k, v in AMOUNTS.items() if k != "equivalents"}, "amount")
        return XdlQuantity(found.sort, found.reading, is_per_equivalent=True)
    return _first(text, AMOUNTS, "amount")


def _first(text: str, notations: Mapping[str, Notation], what: str) -> XdlQuantity:
    unknown: UnitError | None = None
    for sort, notation in notations.items():
        try:
            return XdlQuantity(sort, read_quantity(text, notation))
        except UnitError as error:
            if error.code != "unit.unknown":
                raise
            unknown = error
    units = ", ".join(next(iter(n.units)) for n in notations.values())
    message = f"{text!r} is no {what}: it is written with a unit such as {units}"
    raise UnitError(message, code="unit.unknown") from unknown


def _amount_or_all(text: str) -> XdlQuantity:
    if text.strip() == "all":
        return XdlQuantity("volume", QuantityReading(word="all"))
    return read_amount(text)


def _choice(text: str, choices: tuple[str, ...]) -> str:
    if text not in choices:
        raise UnitError(f"{text!r:.60} is none of {', '.join(choices)}", code="xdl.unknown_choice")
    return text


def _bool(text: str) -> bool:
    if text not in _TRUTH:
        raise UnitError(f"{text!r:.60} is neither true nor false", code="xdl.bad_value")
    return _TRUTH[text]


def _stirring(text: str) -> bool | str:
    return text if text == "solvent" else _bool(text)


def _count(text: str) -> int:
    plain = text.strip().removesuffix(".0")
    if not _COUNT.fullmatch(plain):
        raise UnitError(f"{text!r:.60} is no whole number", code="xdl.bad_value")
    return int(plain)


def _number(text: str) -> Decimal:
    if not _NUMBER.fullmatch(text.strip()):
        raise UnitError(f"{text!r:.60} is no number", code="xdl.bad_value")
    return Decimal(text.strip())


def _formula(text: str) -> str:
    if not _FORMULA.fullmatch(text):
        raise UnitError(f"{text!r:.60} is no molecular formula", code="xdl.bad_value")
    return text


def _masses(text: str) -> tuple[Value, ...]:
    return tuple(XdlQuantity("mass", read_quantity(part, MASS)) for part in _parts(text))


def _parts(text: str) -> tuple[str, ...]:
    if not text.strip():
        raise UnitError("a list is empty", code="xdl.empty_value")
    return tuple(text.split())


_READERS: Mapping[str, Callable[[str], Value]] = {
    "amount": read_amount,
    "amount_or_all": _amount_or_all,
    "concentration": lambda text: _first(text, CONCENTRATIONS, "concentration"),
    "bool": _bool,
    "stirring": _stirring,
    "count": _count,
    "number": _number,
    "formula": _formula,
    "masses": _masses,
    "reagents": _parts,
}
