"""Chromatograms and mass spectra as ANDI (AIA), a netCDF file."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from netCDF4 import Dataset

from labweb.common.instruments.model import Column, Found, Parsed, finite, stop, whole_text

_SIGNATURES = (b"CDF\x01", b"CDF\x02")
_MOST_POINTS = 100_000_000
_PEAKS = {"peak_area": "peak area", "peak_height": "peak height"}


def read(path: Path) -> Parsed:
    """Read a chromatogram with its peaks, or a series of mass scans.

    Raises:
        DefinitionError: It is no classic netCDF, or a variable or attribute that the standard
            asks for is missing or of another length; the finding names it.

    Source:
        ASTM E1947 and E1948 (chromatography), E2077 and E2078 (mass spectrometry).
    """
    with path.open("rb") as file:
        if file.read(4) not in _SIGNATURES:
            raise stop("the file is no classic netCDF", "byte 0")
    try:
        data = Dataset(path, "r")
    except OSError as error:
        raise stop(
            f"the netCDF cannot be opened: {whole_text(error.strerror)}", "header"
        ) from error
    with data:
        data.set_auto_mask(False)
        if "ordinate_values" in data.variables:
            return _chromatogram(data)
        if "mass_values" in data.variables:
            return _scans(data)
    raise stop("there is neither ordinate_values nor mass_values", "variables")


def _values(data: Dataset, name: str) -> Any:  # noqa: ANN401 - an array of numpy
    if name not in data.variables:
        raise stop("the variable is missing", name)
    variable = data.variables[name]
    if variable.size > _MOST_POINTS:
        raise stop(f"more than {_MOST_POINTS} values", name)
    scale = finite(getattr(variable, "scale_factor", 1.0), f"{name}:scale_factor")
    variable.set_auto_scale(False)
    return finite(np.ravel(variable[...]), name) * scale


def _scalar(data: Dataset, name: str) -> float:
    found = _values(data, name)
    if found.size != 1:
        raise stop(f"{found.size} values where there is one", name)
    return float(found[0])


def _attribute(data: Dataset, name: str) -> str:
    return whole_text(getattr(data, name, ""))


def _chromatogram(data: Dataset) -> Parsed:
    y = _values(data, "ordinate_values")
    if not y.size:
        raise stop("there is no data", "ordinate_values")
    # The standard counts times in seconds; the attribute says so for the reader.
    unit = _attribute(data, "retention_unit")
    if not unit:
        raise stop("the attribute is missing", "retention_unit")
    detector = _attribute(data, "detector_unit")
    if not detector:
        raise stop("the attribute is missing", "detector_unit")
    x = _times(data, y.size)
    name = _attribute(data, "detector_name") or "chromatogram"
    facts = _facts(data)
    trace = Found(
        name=name, quantity="chromatogram", unit=detector, table=0, column="detector response",
        axes=("retention time",), measured_at=_instant(data), facts=facts,
    )  # fmt: skip
    columns = (Column("retention time", unit, x), Column("detector response", detector, y))
    peaks = list(_peaks(data, unit))
    tables = (columns, tuple(peaks)) if peaks else (columns,)
    readings = [trace]
    readings += [
        Found(
            name=column.name, quantity=column.name, unit=column.unit, table=1,
            column=column.name, axes=("retention time",), measured_at=_instant(data),
        )
        for column in peaks[1:]
    ]  # fmt: skip
    return Parsed(tables, tuple(readings), facts)


def _times(data: Dataset, count: int) -> Any:  # noqa: ANN401 - an array of numpy
    if "raw_data_retention" in data.variables:
        x = _values(data, "raw_data_retention")
        if x.size != count:
            raise stop(f"{x.size} times for {count} ordinates", "raw_data_retention")
        return x
    interval = _scalar(data, "actual_sampling_interval")
    if interval <= 0:
        raise stop(f"the interval is {interval}", "actual_sampling_interval")
    return _scalar(data, "actual_delay_time") + interval * np.arange(count)


def _peaks(data: Dataset, unit: str) -> Iterator[Column]:
    if "peak_retention_time" not in data.variables:
        return
    times = _values(data, "peak_retention_time")
    if not times.size:
        return
    yield Column("retention time", unit, times)
    for variable, name in _PEAKS.items():
        if variable in data.variables:
            found = _values(data, variable)
            if found.size != times.size:
                raise stop(f"{found.size} values for {times.size} peaks", variable)
            # The standard leaves it to the writer.
            yield Column(name, "", found)


def _scans(data: Dataset) -> Parsed:
    times, counts = _values(data, "scan_acquisition_time"), _values(data, "point_count")
    mass, intensity = _values(data, "mass_values"), _values(data, "intensity_values")
    starts = _values(data, "scan_index")
    for name, found in (("point_count", counts), ("scan_index", starts)):
        if found.size != times.size:
            raise stop(f"{found.size} values for {times.size} scans", name)
    if not times.size:
        raise stop("there is no scan", "scan_acquisition_time")
    if (counts < 0).any() or mass.size != intensity.size or counts.sum() > mass.size:
        raise stop(f"{int(counts.sum())} points told, {mass.size} there", "point_count")
    if (starts != np.concatenate(([0], np.cumsum(counts)[:-1]))).any():
        raise stop("the scans do not follow each other without a gap", "scan_index")
    used, index = int(counts.sum()), np.arange(1, times.size + 1)
    unit = whole_text(getattr(data.variables["intensity_values"], "units", ""))
    mass_unit = whole_text(getattr(data.variables["mass_values"], "units", ""))
    totals = np.add.reduceat(np.append(intensity[:used], 0.0), starts.astype(int))
    totals[counts == 0] = 0.0
    scans = (
        Column("scan", "1", index),
        Column("acquisition time", "Seconds", times),
        Column("total intensity", unit, totals),
    )
    points = (
        Column("scan", "1", np.repeat(index, counts.astype(int))),
        Column("mass", mass_unit, mass[:used]),
        Column("intensity", unit, intensity[:used]),
    )
    at = _instant(data)
    readings = (
        Found(
            name="scans", quantity="number of scans", unit="1", value=float(times.size),
            measured_at=at,
        ),
        Found(
            name="total intensity by scan", quantity="total ion current", unit=unit, table=0,
            column="total intensity", axes=("acquisition time",), measured_at=at,
        ),
        Found(
            name="mass spectra", quantity="mass spectrum", unit=unit, table=1,
            column="intensity", axes=("scan", "mass"), measured_at=at,
        ),
    )  # fmt: skip
    return Parsed((scans, points), readings, _facts(data))


def _instant(data: Dataset) -> str | None:
    """Return when the run was injected; the stamp is `YYYYMMDDhhmmss±ffff`."""
    for name in ("injection_date_time_stamp", "experiment_date_time_stamp"):
        try:
            return datetime.strptime(_attribute(data, name), "%Y%m%d%H%M%S%z").isoformat()
        except ValueError:
            continue
    return None


def _facts(data: Dataset) -> dict[str, str]:
    return {whole_text(n): whole_text(getattr(data, n)) for n in list(data.ncattrs())[:200]}
