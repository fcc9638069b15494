"""XML of instruments: AnIML, and what a Neware cycler answers. Anything else is refused."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

import numpy as np

# Tells no types.
from defusedxml import DefusedXmlException  # type: ignore[import-untyped]
from defusedxml.ElementTree import parse  # type: ignore[import-untyped]

from labweb.common.instruments.model import Column, Found, Parsed, finite, number, stop, whole_text

_DTYPES = {"Int32": "<i4", "Int64": "<i8", "Float32": "<f4", "Float64": "<f8"}
_NUMBERS = {"I": "Int32", "L": "Int64", "F": "Float32", "D": "Float64"}
_MOST_POINTS = 50_000_000

# Volt, ampere, ampere hour, watt hour and milliseconds, as the cycler's interface counts.
_BTS_UNITS = {
    "steptime": "ms", "startvolt": "V", "endvolt": "V", "startcurr": "A", "endcurr": "A",
    "cap": "A h", "eng": "W h",
    "volt": "V", "curr": "A", "testtime": "ms",
}  # fmt: skip
_BTS_WHOLE = ("stepindex", "stepid", "cycleid", "startseqid", "endseqid", "seqid")


def read(path: Path) -> Parsed:
    """Read an XML file by its root element.

    Raises:
        DefinitionError: It is not well-formed, declares a DTD or entities, is of an unknown
            kind, or a field of it is wrong.

    Source:
        ASTM AnIML core schema 0.90; answers of the Neware BTS interface, version 1.0.
    """
    root = parse_safely(path)
    name = local(root)
    if name == "AnIML":
        return _animl(root)
    if name == "bts":
        return _bts(root)
    raise stop(f"the root element {name!r} is neither AnIML nor bts", "line 1")


def parse_safely(path: Path) -> Element:
    """Return the root of a document that has no DTD.

    Raises:
        DefinitionError: It is not well-formed, or has a DTD; the finding names the line.
    """
    try:
        root: Element = parse(path, forbid_dtd=True).getroot()
    except ParseError as error:
        line, column = error.position
        raise stop(f"not well-formed: {error.msg}", f"line {line}, column {column}") from error
    except DefusedXmlException as error:
        raise stop("a DTD or entities are not taken", "line 1") from error
    except (LookupError, ValueError) as error:
        raise stop(f"the encoding cannot be read: {error}", "line 1") from error
    return root


def local(element: Element) -> str:
    """Return the name of an element without its namespace."""
    return element.tag.rsplit("}", 1)[-1]


def _children(element: Element, name: str) -> Iterator[Element]:
    return (child for child in element if local(child) == name)


def _all(element: Element, name: str) -> Iterator[Element]:
    return (child for child in element.iter() if local(child) == name)


def _animl(root: Element) -> Parsed:
    tables: list[tuple[Column, ...]] = []
    readings: list[Found] = []
    samples = [
        {"id": whole_text(s.get("sampleID", "")), "name": whole_text(s.get("name", ""))}
        for s in _all(root, "Sample")
    ]
    for place, series_set in enumerate(_all(root, "SeriesSet"), 1):
        path = f"SeriesSet[{place}]"
        columns, axes = _series_set(series_set, path)
        name = whole_text(series_set.get("name", path))
        measured = [c for c in columns if c.name not in axes]
        if not axes or not measured:
            raise stop("a set needs a series that is independent and one that is not", path)
        tables.append(columns)
        readings += [
            Found(
                name=f"{name}: {column.name}",
                quantity=column.name,
                unit=column.unit,
                table=len(tables) - 1,
                column=column.name,
                axes=axes,
            )
            for column in measured
        ]
    if not readings:
        raise stop("there is no SeriesSet with data", "AnIML")
    return Parsed(tuple(tables), tuple(readings), {"samples": samples[:100]})


def _series_set(series_set: Element, path: str) -> tuple[tuple[Column, ...], tuple[str, ...]]:
    length = _whole(series_set.get("length"), f"{path}/@length")
    columns: list[Column] = []
    axes: list[str] = []
    for place, series in enumerate(_children(series_set, "Series"), 1):
        where = f"{path}/Series[{place}]"
        name = whole_text(series.get("name", "") or series.get("seriesID", ""))
        if not name or name in {c.name for c in columns}:
            raise stop("a series needs a name of its own", f"{where}/@name")
        kind = series.get("seriesType", "")
        values = _series(series, kind, length, where)
        if len(values) != length:
            raise stop(f"{len(values)} values where the set says {length}", where)
        columns.append(Column(name, _unit(series), finite(values, where)))
        if series.get("dependency") == "independent":
            axes.append(name)
    return tuple(columns), tuple(axes)


def _unit(series: Element) -> str:
    unit = next(_children(series, "Unit"), None)
    return "" if unit is None else whole_text(unit.get("label", ""))


def _series(series: Element, kind: str, length: int, where: str) -> Any:  # noqa: ANN401 - numbers
    if kind not in _DTYPES:
        raise stop(f"series of type {kind!r} are not read", f"{where}/@seriesType")
    values: list[float] = []
    for part in series:
        match local(part):
            case "IndividualValueSet":
                values += [_number(v.text, f"{where}/IndividualValueSet") for v in part]
            case "EncodedValueSet":
                values += list(_decoded(part.text or "", _DTYPES[kind], where))
            case "AutoIncrementedValueSet":
                start, step = (_bound(part, tag, where) for tag in ("StartValue", "Increment"))
                values += list(start + step * np.arange(length))
    return values


def _bound(part: Element, tag: str, where: str) -> float:
    holder = next(_children(part, tag), None)
    if holder is None or len(holder) != 1:
        raise stop(f"{tag} is missing", f"{where}/AutoIncrementedValueSet")
    return _number(holder[0].text, f"{where}/AutoIncrementedValueSet/{tag}")


def _decoded(text: str, dtype: str, where: str) -> Any:  # noqa: ANN401 - numbers
    try:
        raw = base64.b64decode("".join(text.split()), validate=True)
        return np.frombuffer(raw, dtype=dtype)
    except (binascii.Error, ValueError) as error:
        raise stop(
            f"the encoded values cannot be read: {error}", f"{where}/EncodedValueSet"
        ) from error


def _number(text: str | None, where: str) -> float:
    value = number((text or "").strip())
    if value is None:
        raise stop(f"{(text or '')[:40]!r} is no number", where)
    return value


def _whole(text: str | None, where: str) -> int:
    if text is None or not text.isascii() or not text.isdigit() or len(text) > 12:
        raise stop(f"{(text or '')[:40]!r} is no count", where)
    if not 0 < int(text) <= _MOST_POINTS:
        raise stop(f"a set has 1 to {_MOST_POINTS} values", where)
    return int(text)


def _bts(root: Element) -> Parsed:
    rows = [dict(row.attrib) for row in root.findall("list/data")]
    command = whole_text(root.findtext("cmd", ""))
    told = next((e for e in root if e.get("testid") is not None), None)
    known = [name for name in (*_BTS_WHOLE, *_BTS_UNITS) if rows and name in rows[0]]
    measured = [name for name in known if name in _BTS_UNITS]
    axis = next((name for name in _BTS_WHOLE if name in known), None)
    if not measured or axis is None:
        raise stop("the answer holds no list of measured steps or records", f"bts/{command}")
    count = root.find("list")
    if count is not None and count.get("count") != str(len(rows)):
        raise stop(f"{len(rows)} entries where the list says {count.get('count')}", "list/@count")
    columns = tuple(
        Column(
            name,
            _BTS_UNITS.get(name, "1"),
            [_number(row.get(name), f"list/data[{at}]/@{name}") for at, row in enumerate(rows, 1)],
        )
        for name in known
    )
    readings = tuple(
        Found(name=n, quantity=n, unit=_BTS_UNITS[n], table=0, column=n, axes=(axis,))
        for n in measured
    )
    facts = (
        {"command": command} | {}
        if told is None
        else {"command": command, **{k: whole_text(v) for k, v in told.attrib.items()}}
    )
    return Parsed((columns,), readings, facts)
