"""Tables as text: one axis, and measured columns whose units stand in the header."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from labweb.common.instruments.model import (
    Column,
    Found,
    Parsed,
    number,
    refuse,
    stop,
    whole_text,
    wrong,
)
from labweb.domain.errors import Finding

MOST_COLUMNS = 500
MOST_LINES = 5_000_000

_HEAD = re.compile(r"(?P<name>[^()\[\]]+?)\s*[(\[](?P<unit>[^()\[\]]+)[)\]]")
_DELIMITERS = (",", ";", "\t")
TEXT, TIME = "text", "time"


def read(path: Path) -> Parsed:
    """Read a table.

    Raises:
        DefinitionError: Findings name each line and column that is wrong.

    Source:
        RFC 4180, with the unit of each column in its header.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return _table(_numbered(file))
    except UnicodeDecodeError as error:
        raise stop(f"the text is not UTF-8: {error.reason}", f"byte {error.start}") from error
    except csv.Error as error:
        raise stop(str(error), "") from error


def _numbered(file: Iterator[str]) -> Iterator[tuple[int, str]]:
    for at, line in enumerate(file, 1):
        if at > MOST_LINES:
            raise stop(f"the file has more than {MOST_LINES} lines", f"line {at}")
        if "\x00" in line:
            raise stop("a line holds U+0000", f"line {at}")
        yield at, line


def _table(lines: Iterator[tuple[int, str]]) -> Parsed:
    facts: dict[str, str] = {}
    for at, line in lines:
        if not line.startswith("#"):
            return _body(at, line, lines, facts)
        key, colon, value = line[1:].partition(":")
        if colon:
            facts[whole_text(key)] = whole_text(value)
    raise stop("there is no header", "line 1")


def _body(at: int, header: str, lines: Iterator[tuple[int, str]], facts: dict[str, str]) -> Parsed:
    present = [mark for mark in _DELIMITERS if mark in header]
    if len(present) != 1:
        raise stop(
            "the header must be parted by comma, semicolon or tab, and one alone", f"line {at}"
        )
    heads = _heads(next(csv.reader([header], delimiter=present[0], strict=True)), at)
    cells: list[list[object]] = [[] for _ in heads]
    findings: list[Finding] = []
    texts = (line for _, line in lines)
    reader = csv.reader(texts, delimiter=present[0], strict=True)
    for row in reader:
        place = f"line {at + reader.line_num}"
        if len(row) != len(heads):
            findings.append(wrong(f"{len(row)} cells where the header has {len(heads)}", place))
            continue
        for (name, unit), column, cell in zip(heads, cells, row, strict=True):
            column.append(_cell(cell.strip(), unit, f"{place}, {name}", findings))
    findings += _check_axis(heads, cells, at)
    if findings:
        raise refuse(findings)
    return _parsed(heads, cells, facts)


def _heads(row: list[str], at: int) -> list[tuple[str, str]]:
    heads, findings = [], []
    for place, cell in enumerate(row, 1):
        found = _HEAD.fullmatch(cell.strip())
        if found is None:
            what = f"column {place} {cell.strip()[:40]!r} has no unit: write name (unit), "
            findings.append(wrong(what + "(1) for a pure number, (text) or (time)", f"line {at}"))
        else:
            heads.append((whole_text(found["name"]), whole_text(found["unit"])))
    names = [name for name, _ in heads]
    findings += [
        wrong(f"two columns are called {name!r}", f"line {at}")
        for name in sorted({name for name in names if names.count(name) > 1})
    ]
    if len(row) > MOST_COLUMNS:
        findings.append(wrong(f"more than {MOST_COLUMNS} columns", f"line {at}"))
    if findings:
        raise refuse(findings)
    return heads


def _cell(cell: str, unit: str, place: str, findings: list[Finding]) -> object:
    if not cell:
        return None
    if unit == TEXT:
        return whole_text(cell)
    if unit == TIME:
        found = _instant(cell)
        if found is None:
            what = f"{cell[:40]!r} is no time with an offset, like 2026-01-31T09:00:00+01:00"
            findings.append(wrong(what, place))
        return found
    value = number(cell)
    if value is None:
        findings.append(wrong(f"{cell[:40]!r} is no number with a decimal point", place))
    return value


def _instant(cell: str) -> datetime | None:
    try:
        at = datetime.fromisoformat(cell)
    except ValueError:
        return None
    return None if at.tzinfo is None else at


def _check_axis(
    heads: list[tuple[str, str]], cells: list[list[object]], at: int
) -> Iterator[Finding]:
    name, unit = heads[0]
    if unit == TEXT:
        yield wrong(f"the first column {name!r} is the axis and cannot be text", f"line {at}")
    if not any(unit not in {TEXT, TIME} for _, unit in heads[1:]):
        yield wrong("no column after the first holds numbers", f"line {at}")
    if not cells[0]:
        yield wrong("there is no line of data", f"line {at}")
    elif None in cells[0]:
        place = f"data line {cells[0].index(None) + 1}, {name}"
        yield wrong("the first column is the axis and may have no gap", place)


def _parsed(
    heads: list[tuple[str, str]], cells: list[list[object]], facts: dict[str, str]
) -> Parsed:
    columns = tuple(
        Column(name, unit, held) for (name, unit), held in zip(heads, cells, strict=True)
    )
    axis = columns[0]
    readings = []
    for column in columns[1:]:
        told = [value for value in column.values if value is not None]
        if column.unit in {TEXT, TIME} or not told:
            continue
        found = Found(
            name=column.name,
            quantity=column.name,
            unit=column.unit,
            table=0,
            column=column.name,
            axes=(axis.name,),
        )
        readings.append(found)
    if not readings:
        raise stop("no column after the first holds a number", "")
    return Parsed((columns,), tuple(readings), facts)
