"""Mass spectra as mzML, read by pyteomics after the document itself was found sound."""

from __future__ import annotations

import warnings
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

import numpy as np

# Neither tells its types.
from defusedxml import DefusedXmlException  # type: ignore[import-untyped]
from defusedxml.ElementTree import iterparse  # type: ignore[import-untyped]
from lxml.etree import XMLSyntaxError  # type: ignore[import-untyped]
from pyteomics.auxiliary import PyteomicsError  # type: ignore[import-untyped]
from pyteomics.mzml import MzML  # type: ignore[import-untyped]

from labweb.common.instruments.model import Column, Found, Parsed, finite, stop, whole_text
from labweb.common.instruments.xml_file import local

_MOST_POINTS = 100_000_000
_ARRAYS = {
    "MS:1000514": "m/z array",
    "MS:1000515": "intensity array",
    "MS:1000595": "time array",
}
_RUN_START = "startTimeStamp"


class _Untyped:
    """A term without relations: numbers are read as numbers, all else as text."""

    relationship = ()


class _Vocabulary:
    """Stands for the PSI vocabulary, so that no file makes this process fetch one."""

    def __getitem__(self, _accession: str) -> _Untyped:
        return _Untyped()


@dataclass
class _Outline:
    """What the document promises, from a first pass over it."""

    units: dict[str, str] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    promised: dict[str, str] = field(default_factory=dict)
    version: str = ""
    started: str = ""


@dataclass
class _Scans:
    """The spectra as they come, one row each, and all their peaks."""

    levels: list[float] = field(default_factory=list)
    ids: list[str] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    time_units: set[str] = field(default_factory=set)
    totals: list[float] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    mz: list[Any] = field(default_factory=list)
    intensity: list[Any] = field(default_factory=list)


def read(path: Path) -> Parsed:
    """Read every spectrum and chromatogram.

    Raises:
        DefinitionError: The document is not well-formed, not mzML, promises another number of
            spectra than it has, or an array of a spectrum is wrong.

    Source:
        HUPO-PSI mzML 1.1.0.
    """
    outline = _outline(path)
    scans = _Scans()
    tables: list[tuple[Column, ...]] = []
    readings: list[Found] = []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with MzML(str(path), use_index=False, cv=_Vocabulary()) as reader:
                for spectrum in reader:
                    _take(spectrum, scans)
            with MzML(str(path), use_index=False, cv=_Vocabulary()) as reader:
                for chromatogram in reader.iterfind("chromatogram"):
                    _chromatogram(chromatogram, outline, tables, readings)
    except (PyteomicsError, XMLSyntaxError, KeyError, ValueError) as error:
        raise stop(f"the spectra cannot be read: {whole_text(error)}", _place(scans)) from error
    if scans.ids:
        _spectra(scans, outline, tables, readings)
    if not readings:
        raise stop("there is no spectrum and no chromatogram", "mzML/run")
    facts = {"version": outline.version, "run_started": outline.started}
    return Parsed(tuple(tables), tuple(readings), facts)


def _place(scans: _Scans) -> str:
    return f"spectrum {len(scans.ids) + 1}"


def _outline(path: Path) -> _Outline:
    outline = _Outline()
    try:
        for event, element in iterparse(path, events=("start", "end"), forbid_dtd=True):
            if event == "start":
                _begin(element, outline)
            elif local(element) not in {"cvParam", "binary"}:
                element.clear()
    except ParseError as error:
        line, column = error.position
        raise stop(f"not well-formed: {error.msg}", f"line {line}, column {column}") from error
    except DefusedXmlException as error:
        raise stop("a DTD or entities are not taken", "line 1") from error
    if not outline.version:
        raise stop("there is no mzML element with a version", "line 1")
    for name, inside in (("spectrumList", "spectrum"), ("chromatogramList", "chromatogram")):
        told = outline.promised.get(name)
        if told is not None and told != str(outline.counts[inside]):
            raise stop(f"{outline.counts[inside]} where the list says {told}", f"{name}/@count")
    return outline


def _begin(element: Element, outline: _Outline) -> None:
    name = local(element)
    outline.counts[name] += 1
    match name:
        case "mzML":
            outline.version = whole_text(element.get("version", ""))
        case "run":
            outline.started = whole_text(element.get(_RUN_START, ""))
        case "spectrumList" | "chromatogramList":
            outline.promised[name] = element.get("count", "")
        case "cvParam" if element.get("accession") in _ARRAYS:
            array = _ARRAYS[element.get("accession", "")]
            unit = whole_text(element.get("unitName", ""))
            if outline.units.setdefault(array, unit) != unit:
                raise stop(f"{array} has the units {outline.units[array]} and {unit}", "cvParam")


def _take(spectrum: dict[str, Any], scans: _Scans) -> None:
    where = f"spectrum {whole_text(spectrum.get('id', ''))!r}"
    mz = finite(spectrum.get("m/z array", ()), f"{where}, m/z array")
    intensity = finite(spectrum.get("intensity array", ()), f"{where}, intensity array")
    promised = spectrum.get("defaultArrayLength")
    if len(mz) != len(intensity) or promised not in {None, len(mz)}:
        told = f"{len(mz)} m/z values, {len(intensity)} intensities, {promised} promised"
        raise stop(told, where)
    if sum(scans.counts) + len(mz) > _MOST_POINTS:
        raise stop(f"more than {_MOST_POINTS} peaks", where)
    scan = (spectrum.get("scanList", {}).get("scan") or [{}])[0]
    time = scan.get("scan start time")
    if time is None:
        raise stop("the scan has no start time", where)
    scans.time_units.add(whole_text(getattr(time, "unit_info", "") or ""))
    scans.ids.append(whole_text(spectrum.get("id", "")))
    scans.levels.append(float(spectrum.get("ms level", 0)))
    scans.times.append(float(finite([time], where)[0]))
    scans.totals.append(float(intensity.sum()))
    scans.counts.append(len(mz))
    scans.mz.append(mz)
    scans.intensity.append(intensity)


def _spectra(
    scans: _Scans, outline: _Outline, tables: list[tuple[Column, ...]], readings: list[Found]
) -> None:
    if len(scans.time_units) != 1:
        raise stop(f"start times in {sorted(scans.time_units)}", "spectrumList")
    (unit,) = scans.time_units
    counts = outline.units.get("intensity array", "")
    first = len(tables)
    index = np.arange(1, len(scans.ids) + 1)
    tables.append(
        (
            Column("scan", "1", index),
            Column("id", "text", scans.ids),
            Column("ms level", "1", np.asarray(scans.levels)),
            Column("scan start time", unit, np.asarray(scans.times)),
            Column("total intensity", counts, np.asarray(scans.totals)),
            Column("peaks", "1", np.asarray(scans.counts)),
        )
    )
    tables.append(
        (
            Column("scan", "1", np.repeat(index, scans.counts)),
            Column("m/z", outline.units.get("m/z array", ""), np.concatenate(scans.mz)),
            Column("intensity", counts, np.concatenate(scans.intensity)),
        )
    )
    for level, count in sorted(Counter(scans.levels).items()):
        name = f"scans of MS level {level:g}"
        readings.append(Found(name=name, quantity="number of scans", unit="1", value=float(count)))
    readings += [
        Found(
            name="total intensity by scan", quantity="total ion current", unit=counts,
            table=first, column="total intensity", axes=("scan start time",),
        ),
        Found(
            name="mass spectra", quantity="mass spectrum", unit=counts,
            table=first + 1, column="intensity", axes=("scan", "m/z"),
        ),
    ]  # fmt: skip


def _chromatogram(
    found: dict[str, Any],
    outline: _Outline,
    tables: list[tuple[Column, ...]],
    readings: list[Found],
) -> None:
    where = f"chromatogram {whole_text(found.get('id', ''))!r}"
    time = finite(found.get("time array", ()), f"{where}, time array")
    intensity = finite(found.get("intensity array", ()), f"{where}, intensity array")
    if len(time) != len(intensity) or not len(time):
        raise stop(f"{len(time)} times and {len(intensity)} intensities", where)
    counts = outline.units.get("intensity array", "")
    tables.append(
        (
            Column("time", outline.units.get("time array", ""), time),
            Column("intensity", counts, intensity),
        )
    )
    readings.append(
        Found(
            name=whole_text(found.get("id", "")), quantity="chromatogram", unit=counts,
            table=len(tables) - 1, column="intensity", axes=("time",),
        )
    )  # fmt: skip
