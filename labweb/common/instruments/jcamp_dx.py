"""Spectra as JCAMP-DX, read by the `jcamp` package and held against what the header promises."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

# Tells no types.
import jcamp  # type: ignore[import-untyped]
import numpy as np

from labweb.common.instruments.model import (
    Column,
    Found,
    Parsed,
    finite,
    number,
    refuse,
    stop,
    whole_text,
    wrong,
)
from labweb.domain.errors import Finding

_DATA = ("xydata", "xypoints", "peak table")
_LABEL = re.compile(r"##([^=]*)=(.*)")
_TOLERANCE = 1e-6
_MOST_POINTS = 20_000_000


def read(path: Path) -> Parsed:
    """Read one spectrum or a file of linked ones.

    Raises:
        DefinitionError: A label is missing, a checkpoint fails or a count is not the one told;
            findings name the line or the label.

    Source:
        JCAMP-DX 4.24 (Appl. Spectrosc. 42 (1988) 151) and 5.01.
    """
    try:
        text = path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise stop(f"the text is not UTF-8: {error.reason}", f"byte {error.start}") from error
    lines = text.splitlines()
    _check_labels(lines)
    told = io.StringIO()
    with contextlib.redirect_stdout(told):
        found = jcamp.read(lines)
    if told.getvalue():
        raise stop(whole_text(told.getvalue().splitlines()[0]), "a check of the data failed")
    blocks = found.get("children") or [found]
    tables, readings = [], []
    for place, block in enumerate(blocks, 1):
        where = f"block {place}" if len(blocks) > 1 else "##"
        columns = _columns(block, where)
        tables.append(columns)
        readings.append(
            Found(
                name=whole_text(block.get("title", "")) or where,
                quantity=whole_text(block.get("data type", block.get("datatype", ""))).lower(),
                unit=columns[1].unit,
                table=place - 1,
                column=columns[1].name,
                axes=(columns[0].name,),
                measured_at=_instant(block.get("longdate")),
                facts=_facts(block),
            )
        )
    return Parsed(tuple(tables), tuple(readings), {"title": whole_text(found.get("title", ""))})


def _check_labels(lines: list[str]) -> None:
    """See to it that the file is a closed block of labelled records."""
    if not lines or not lines[0].upper().startswith("##TITLE="):
        raise stop("the first line must be ##TITLE=", "line 1")
    findings: list[Finding] = []
    opened = 0
    for at, line in enumerate(lines, 1):
        if not line.startswith("##"):
            continue
        found = _LABEL.match(line)
        if found is None:
            findings.append(wrong("a label has no =", f"line {at}"))
            continue
        label = found[1].strip().upper()
        opened += (label == "TITLE") - (label == "END")
        value = found[2].split("$$")[0].strip()
        if label in {"NPOINTS", "FIRSTX", "LASTX", "XFACTOR", "YFACTOR"} and number(value) is None:
            findings.append(wrong(f"{value[:40]!r} is no number", f"line {at}, ##{label}"))
        if label == "NPOINTS" and not 1 <= (number(value) or 0) <= _MOST_POINTS:
            findings.append(wrong(f"1 to {_MOST_POINTS} points", f"line {at}, ##NPOINTS"))
    if opened:
        findings.append(wrong("##TITLE= and ##END= do not match", f"line {len(lines)}"))
    if findings:
        raise refuse(findings)


def _columns(block: dict[str, Any], where: str) -> tuple[Column, Column]:
    findings = list(_missing(block, where))
    if findings:
        raise refuse(findings)
    x, y = finite(block["x"], f"{where} X"), finite(block["y"], f"{where} Y")
    if len(x) != len(y):
        raise stop(f"{len(x)} abscissas and {len(y)} ordinates", f"{where} NPOINTS")
    if not len(x):
        raise stop("there is no data", where)
    told = block.get("npoints")
    if told is not None and int(told) != len(y):
        raise stop(f"{len(y)} points where the file says {told}", f"{where} NPOINTS")
    _check_first(block, y, where)
    return (
        Column("x", whole_text(block["xunits"]), x),
        Column("y", whole_text(block["yunits"]), y),
    )


def _check_first(block: dict[str, Any], y: Any, where: str) -> None:  # noqa: ANN401 - an array
    """Hold the first ordinate against FIRSTY, which may be rounded to one step of YFACTOR."""
    told = block.get("firsty")
    if "xydata" not in block or not isinstance(told, int | float):
        return
    room = max(_TOLERANCE * float(np.max(np.abs(y))), abs(float(block.get("yfactor", 1.0))))
    if abs(float(told) - float(y[0])) > room:
        raise stop(f"the first ordinate is {float(y[0])}, FIRSTY says {told}", f"{where} FIRSTY")


def _missing(block: dict[str, Any], where: str) -> Iterator[Finding]:
    needed = ["xunits", "yunits"]
    if "xydata" in block:
        needed += ["firstx", "lastx", "npoints"]
    yield from (
        wrong(f"##{name.upper()}= is missing", where) for name in needed if name not in block
    )
    if "data type" not in block and "datatype" not in block:
        yield wrong("##DATA TYPE= is missing", where)
    if "jcamp-dx" not in block and "jcampdx" not in block:
        yield wrong("##JCAMP-DX= is missing", where)
    if not any(name in block for name in _DATA):
        yield wrong("none of ##XYDATA=, ##XYPOINTS= and ##PEAK TABLE= is there", where)


def _instant(value: object) -> str | None:
    is_told = isinstance(value, datetime) and value.tzinfo is not None
    return value.isoformat() if is_told and isinstance(value, datetime) else None


def _facts(block: dict[str, Any]) -> dict[str, str]:
    skipped = {"x", "y", "end", "children", *_DATA}
    return {whole_text(k): whole_text(v) for k, v in list(block.items())[:200] if k not in skipped}
