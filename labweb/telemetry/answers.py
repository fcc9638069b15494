"""What the endpoints of telemetry, of files and of readings answer with."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal
from uuid import UUID

from labweb.common.answers import ApiAnswer, NamedRef, NumberedRef
from labweb.domain.errors import Finding

SampleValue = float | int | str | bool | None
"""What a status can tell."""

FileState = Literal["awaited", "pending", "parsed", "refused", "lost"]
"""Where the reading of a file stands that was brought or named."""


class TelemetrySeries(ApiAnswer):
    """What a device told within a window."""

    series: dict[str, list[tuple[float, SampleValue]]]
    """(seconds since the Unix epoch, value) by status, oldest first."""


class TelemetryCurve(ApiAnswer):
    """One status over a range, as samples or as buckets."""

    status: str
    label: str
    unit: str
    every_s: float | None
    """How often the driver tells it; null: it is no status of the driver any more."""

    is_share: bool
    """It tells yes or no; its buckets tell the share of yes."""

    level_s: int
    """Width of the buckets that were read; 0: these are samples."""

    step_s: int
    """Width of the buckets that are told; 0: these are samples."""

    points: list[tuple[SampleValue, ...]]
    """(seconds, value) of samples, or (begin, mean, lowest, highest, count) of buckets."""


class TelemetryGapRow(ApiAnswer):
    """A time in which samples of a device were lost, or may have been."""

    since: float
    until: float
    lost_count: int | None
    """Over all devices of the same line together; null: nobody knows."""

    reason: str


class TelemetryCurves(ApiAnswer):
    """What a device told within a range, as finely as a plot can show it."""

    since_s: float
    until_s: float
    curves: list[TelemetryCurve]
    gaps: list[TelemetryGapRow]


class PhotoRow(ApiAnswer):
    """A photo of a device."""

    url: str
    """Where its bytes are; another photo has another address."""

    brought_at: datetime
    brought_by: str


class KeptFile(ApiAnswer):
    """A file without its bytes."""

    id: UUID
    name: str
    media_type: str
    format: str
    """How it was read; `none` for one that was only kept, `series` for one made here."""

    size_bytes: int
    sha256: str
    made_from_id: UUID | None
    resource_id: UUID | None
    device_id: UUID | None
    job_id: UUID | None
    kept_by: str
    """Empty: no person brought it."""

    kept_at: datetime


class FileJob(ApiAnswer):
    """The job that a file came from."""

    id: UUID
    index: int
    sentence: str
    run: NumberedRef


class FileRow(KeptFile):
    """A file with the names of what it is about, as far as the caller may know of it."""

    resource: NamedRef | None
    device: NamedRef | None
    job: FileJob | None


class FileList(ApiAnswer):
    """A page of files."""

    files: list[FileRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class SeriesAxis(ApiAnswer):
    """A column of a series, and how far its values go."""

    column: str
    unit: str
    points_count: int
    least: int | float | str | None
    """A text: a time; null: the column has no value."""

    most: int | float | str | None


class ReadingSeries(SeriesAxis):
    """The measured column of a series, and the axes that it is over."""

    axes: list[SeriesAxis]


class ReadingRow(ApiAnswer):
    """One thing that was measured; the values of a series are in its file."""

    id: UUID
    file_id: UUID
    file_sha256: str
    index: int
    """Place in the file."""

    name: str
    quantity: str
    unit: str
    """As the file writes it; empty when it does not tell."""

    value: float | None
    """Null: it is a text or a series."""

    text: str
    series_file_id: UUID | None
    series: ReadingSeries | None
    facts: dict[str, Any]
    measured_at: datetime | None
    """Where the file tells it with its offset."""

    kept_at: datetime
    resource_id: UUID | None
    device_id: UUID | None
    job_id: UUID | None


class ReadingList(ApiAnswer):
    """A page of readings."""

    readings: list[ReadingRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class FileDetail(FileRow):
    """A file with what was read from it."""

    facts: dict[str, Any]
    """What it tells about itself and no reading holds."""

    readings: list[ReadingRow]
    """The first of them; `readings_count` tells how many there are."""

    series: list[KeptFile]
    readings_count: int


class IncomingRow(ApiAnswer):
    """A file that was brought to be read, and what became of it."""

    id: UUID
    name: str
    format: str
    size_bytes: int
    sha256: str
    state: FileState
    file_id: UUID | None
    """The file that it was kept as."""

    code: str
    """Why it was refused; empty: it was not."""

    message: str
    findings: list[Finding]
    resource_id: UUID | None
    device_id: UUID | None
    job_id: UUID | None
    brought_by: str
    """Empty: an action of a host named it."""

    brought_at: datetime
    ended_at: datetime | None


class IncomingList(ApiAnswer):
    """A page of files that were brought to be read."""

    incoming: list[IncomingRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class DrawnColumn(ApiAnswer):
    """The measured column of a plot."""

    column: str
    unit: str
    least: int | float | str | None
    most: int | float | str | None


class DrawnScan(SeriesAxis):
    """The axis that numbers several spectra, and the one that is shown."""

    value: int


class DrawnSeries(ApiAnswer):
    """The points of a reading, with what its axes are."""

    reading_id: UUID
    x: SeriesAxis
    y: DrawnColumn
    scan: DrawnScan | None
    """Null: there is one spectrum only."""

    points: list[tuple[float, float | None]]
    """(x, y); null where the file has a gap."""

    rows_count: int
    is_thinned: bool
    """Of each stretch of rows only the least and the largest value are given."""

    is_time: bool
    """The axis counts seconds since 1970."""
