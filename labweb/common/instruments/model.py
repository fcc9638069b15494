"""What a reader finds in an instrument file, and how it refuses one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from labweb.domain.errors import DefinitionError, Finding

MOST_FINDINGS = 100
"""More are counted and not listed."""

MOST_READINGS = 5_000
"""Readings that one file may give; more is a file to be split."""

LONGEST_TEXT = 500


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a series."""

    name: str
    unit: str
    """As the file writes it; empty when the format leaves it open and the file does not tell."""

    values: Any
    """One-dimensional array of numbers, or a list of numbers, times or texts; None is a gap."""


@dataclass(frozen=True, slots=True)
class Found:
    """One reading: a value, a text, or a column of a table over its axes."""

    name: str
    quantity: str
    unit: str = ""
    value: float | None = None
    text: str = ""
    table: int | None = None
    """Index of the table that holds the series."""

    column: str = ""
    axes: tuple[str, ...] = ()
    """Columns of the same table that the series is over."""

    measured_at: str | None = None
    """ISO 8601 with offset, where the file tells it."""

    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Parsed:
    """All that was found in a file."""

    tables: tuple[tuple[Column, ...], ...]
    readings: tuple[Found, ...]
    facts: Mapping[str, Any] = field(default_factory=dict)


def wrong(message: str, subject: str, **context: object) -> Finding:
    """Return a finding about a place in the file."""
    return Finding("instrument.invalid", message, subject, context)


def refuse(findings: Sequence[Finding]) -> DefinitionError:
    """Return the refusal of a file, with what is wrong in it."""
    first = findings[0]
    where = f"{first.subject}: " if first.subject else ""
    return DefinitionError(
        f"{where}{first.message}",
        code="instrument.invalid",
        context={"findings_count": len(findings)},
        findings=findings[:MOST_FINDINGS],
    )


def stop(message: str, subject: str) -> DefinitionError:
    """Return the refusal of a file for one reason that ends the reading."""
    return refuse([wrong(message, subject)])


def whole_text(value: object) -> str:
    """Return a value of the file as a text of bounded length that a database keeps."""
    text = "".join(mark for mark in str(value) if mark.isprintable())
    return text.strip()[:LONGEST_TEXT]


def finite(values: object, subject: str) -> Any:  # noqa: ANN401 - an array of numpy
    """Return values as float64.

    Raises:
        DefinitionError: They are no numbers, or one of them is not finite.
    """
    try:
        found = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise stop("these are no numbers", subject) from error
    bad = np.flatnonzero(~np.isfinite(found))
    if bad.size:
        raise stop(f"value {int(bad[0]) + 1} of {found.size} is not finite", subject)
    return found


def number(text: str) -> float | None:
    """Return a plain decimal number; None when the text is none, or not finite."""
    if not text or len(text) > 64 or text.strip("0123456789+-.eE"):
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
