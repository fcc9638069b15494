"""Values in PROV-JSON: times, numbers, names, texts in a language."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from labweb.domain.crutd.provenance.qualified_names import PROV, XSD, expand

_TIME = re.compile(r"-?\d{4,}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?(Z|[+-]\d\d:\d\d)?", re.ASCII)
_INTEGER = re.compile(r"[+-]?\d+", re.ASCII)
_DECIMAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)", re.ASCII)
_DOUBLE = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|[+-]?INF|NaN", re.ASCII)
_BOOLEAN = re.compile(r"true|false|1|0")
_LANGUAGE = re.compile(r"[A-Za-z]{1,8}(-[A-Za-z0-9]{1,8})*")
_NAMES = {f"{PROV}QUALIFIED_NAME", f"{XSD}QName"}

_WHOLE: dict[str, tuple[int | None, int | None]] = {
    "integer": (None, None),
    "long": (-(2**63), 2**63 - 1),
    "int": (-(2**31), 2**31 - 1),
    "short": (-(2**15), 2**15 - 1),
    "byte": (-(2**7), 2**7 - 1),
    "nonNegativeInteger": (0, None),
    "positiveInteger": (1, None),
    "nonPositiveInteger": (None, 0),
    "negativeInteger": (None, -1),
    "unsignedLong": (0, 2**64 - 1),
    "unsignedInt": (0, 2**32 - 1),
    "unsignedShort": (0, 2**16 - 1),
    "unsignedByte": (0, 2**8 - 1),
}
_LEXICAL = {
    "decimal": _DECIMAL,
    "double": _DOUBLE,
    "float": _DOUBLE,
    "boolean": _BOOLEAN,
}
_MOST_DIGITS = 4000


@dataclass(frozen=True, slots=True)
class Literal:
    """One value of an attribute."""

    text: str
    """As written; a qualified name written out."""

    type: str
    """Full name of its type."""

    language: str = ""


def read_time(text: str) -> str | None:
    """Return a time in one form, in UTC where its zone is known; None when it is none.

    Example:
        >>> read_time("2012-11-16T18:05:00.000+02:00")
        '2012-11-16T16:05:00+00:00'
    """
    if not _TIME.fullmatch(text):
        return None
    try:
        time = datetime.fromisoformat(text)
    except (ValueError, OverflowError):
        return None
    if time.tzinfo is None:
        return time.isoformat()
    try:
        return time.astimezone(UTC).isoformat()
    except (ValueError, OverflowError):
        return None


def read_value(value: object, prefixes: Mapping[str, str]) -> tuple[Literal | None, str]:
    """Read one value; None with the reason when it is none of PROV-JSON.

    Args:
        value: Any JSON.
        prefixes: Namespace by prefix.
    """
    if isinstance(value, bool):
        return Literal("true" if value else "false", f"{XSD}boolean"), ""
    if isinstance(value, str):
        return Literal(value, f"{XSD}string"), ""
    if isinstance(value, int):
        return Literal(str(value), f"{XSD}integer"), ""
    if isinstance(value, float):
        return Literal(repr(value), f"{XSD}double"), ""
    if not isinstance(value, dict):
        return None, "a value is a text, a number, a truth value or a typed object"
    return _typed(value, prefixes)


def _typed(value: Mapping[str, Any], prefixes: Mapping[str, str]) -> tuple[Literal | None, str]:
    strange = set(value) - {"$", "type", "lang"}
    content, name, language = value.get("$"), value.get("type"), value.get("lang", "")
    if strange:
        return None, f"a typed value has no {min(strange)}"
    if isinstance(content, bool):
        content = "true" if content else "false"
    elif isinstance(content, int | float):
        content = str(content)
    if not isinstance(content, str):
        return None, "a typed value needs its content under $"
    if not isinstance(language, str) or (language and not _LANGUAGE.fullmatch(language)):
        return None, "lang is no tag of a language"
    if language:
        return Literal(content, f"{PROV}InternationalizedString", language), ""
    if name is None:
        return Literal(content, f"{XSD}string"), ""
    kind = expand(name, prefixes) if isinstance(name, str) else None
    if kind is None:
        return None, f"the type {name} is not declared"
    return _checked(content, kind, prefixes)


def _checked(content: str, kind: str, prefixes: Mapping[str, str]) -> tuple[Literal | None, str]:
    if kind in _NAMES:
        full = expand(content, prefixes)
        if full is None:
            return None, f"nobody declared the prefix of {content}"
        return Literal(full, f"{PROV}QUALIFIED_NAME"), ""
    short = kind.removeprefix(XSD)
    text = content.strip()
    if kind == f"{XSD}dateTime":
        time = read_time(text)
        return (None, f"{content!r} is no time") if time is None else (Literal(time, kind), "")
    if short in _WHOLE and kind != short:
        if not _is_whole(text, *_WHOLE[short]):
            return None, f"{content!r} is no {short}"
    elif short in _LEXICAL and kind != short and not _LEXICAL[short].fullmatch(text):
        return None, f"{content!r} is no {short}"
    return Literal(content, kind), ""


def _is_whole(text: str, low: int | None, high: int | None) -> bool:
    if not _INTEGER.fullmatch(text) or len(text) > _MOST_DIGITS:
        return False
    number = int(text)
    return (low is None or number >= low) and (high is None or number <= high)
