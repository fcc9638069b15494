"""Points of a kept series, as a plot needs them."""

from __future__ import annotations

from typing import Any

import msgspec

from labweb.common.series import axes_of, points
from labweb.domain.errors import DefinitionError
from labweb.telemetry.answers import DrawnColumn, DrawnScan, DrawnSeries, SeriesAxis
from labweb.telemetry.selectors import Reading
from labweb.telemetry.services.kept_files import checked


def drawn(reading: Reading, *, scan: int | None, most: int) -> DrawnSeries:
    """Return the points of a reading with what its axes are.

    Args:
        reading: What was measured.
        scan: Which of several spectra; the first when it is not told.
        most: Points at most. Of a longer series each stretch gives its least and its largest.

    Raises:
        DefinitionError: `reading.no_series`: it is a single value. `reading.not_drawn`: its axis
            is a text.
        StateError: `file.damaged`: the series is not the one that was made any more.
    """
    if reading.series is None or reading.series_file is None:
        raise DefinitionError(f"{reading.name!r} is one value", code="reading.no_series")
    axis, numbering = axes_of(reading.series)
    number = None if numbering is None else _number(numbering["least"], scan)
    path = checked(reading.series_file)
    try:
        found = points(path, reading.series, scan=number, most=most)
    except TypeError as error:
        raise DefinitionError(f"{reading.name!r}: {error}", code="reading.not_drawn") from error
    return DrawnSeries(
        reading_id=reading.pk,
        x=msgspec.convert(axis, SeriesAxis),
        y=msgspec.convert(reading.series, DrawnColumn),
        scan=None if numbering is None or number is None else DrawnScan(**numbering, value=number),
        points=list(found.points),
        rows_count=found.rows_count,
        is_thinned=found.is_thinned,
        is_time=isinstance(axis["least"], str),
    )


def _number(least: Any, scan: int | None) -> int:  # noqa: ANN401 - any JSON
    return int(least) if scan is None else scan
