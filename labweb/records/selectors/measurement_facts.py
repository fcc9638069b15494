"""Kept files and readings as facts, each with its place in the record."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from uuid import UUID

from labweb.common.render import iso
from labweb.crutd.selectors import provenance as crutd
from labweb.crutd.selectors.provenance import Window
from labweb.domain.crutd.provenance.recorded_facts import (
    Clue,
    FileFact,
    MeasurementFact,
    ReadingFact,
)
from labweb.resources.selectors import Lab
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry.selectors import File, Reading

MOST_FILES = 500
"""Files as they came that one answer may hold."""

MOST_READINGS = 50
"""Readings of one file that one answer may hold; the file itself has them all."""


@dataclass(frozen=True, slots=True)
class Moment:
    """When something was measured, as far as anybody tells."""

    at: datetime
    seq: int
    clue: Clue


@dataclass(frozen=True, slots=True)
class Measured:
    """Measurements, and whether there are more of them or of their readings."""

    facts: tuple[MeasurementFact, ...] = ()
    has_more: bool = False

    def only(self, reading_id: str) -> Measured:
        """Return the same without other readings than one."""
        facts = [
            replace(fact, readings=[one for one in fact.readings if one.id == reading_id])
            for fact in self.facts
        ]
        return Measured(tuple(facts), self.has_more)


def within(
    lab: Lab, windows: Sequence[Window], jobs: Collection[UUID], ids: Collection[UUID] = ()
) -> Measured:
    """Return what was measured of resources within windows, in jobs, or kept under the ids.

    Which state of a resource was measured goes by the job, else by the moment that the file tells,
    else by the moment at which it was kept, which is later than the measurement.
    """
    stays: dict[UUID, list[tuple[int, int]]] = {}
    for resource, first, last in windows:
        stays.setdefault(resource, []).append((first, last))
    rows = list(telemetry_selectors.files_about(lab, stays, jobs, ids)[: MOST_FILES + 1])
    when = moments(lab, rows)
    kept = [
        row
        for row in rows[:MOST_FILES]
        if row.job_id in jobs or row.pk in ids or _is_within(row, when[row.pk].seq, stays)
    ]
    facts, has_more = _facts(kept, when)
    return Measured(facts, has_more or len(rows) > MOST_FILES)


def _is_within(row: File, seq: int, stays: Mapping[UUID, Sequence[tuple[int, int]]]) -> bool:
    spans = () if row.resource_id is None else stays.get(row.resource_id, ())
    return any(first <= seq <= last for first, last in spans)


def moments(lab: Lab, rows: Iterable[File]) -> dict[UUID, Moment]:
    """Return when each file was measured; four queries at most."""
    files = list(rows)
    jobs = crutd.job_seqs({row.job_id for row in files if row.job_id is not None})
    told = telemetry_selectors.measured_at(row.pk for row in files)
    found: dict[UUID, Moment] = {}
    for row in files:
        if row.job_id in jobs:
            seq, at = jobs[row.job_id]
            found[row.pk] = Moment(at, seq, Clue.JOB)
    clues = {row.pk: told.get(row.pk, row.kept_at) for row in files if row.pk not in found}
    seqs = crutd.seqs_at(lab.pk, clues.values()) if clues else {}
    for file_id, at in clues.items():
        clue = Clue.FILE if file_id in told else Clue.KEPT
        found[file_id] = Moment(at, seqs[at], clue)
    return found


def _facts(
    rows: Sequence[File], when: dict[UUID, Moment]
) -> tuple[tuple[MeasurementFact, ...], bool]:
    ids = [row.pk for row in rows]
    readings: dict[UUID, list[Reading]] = {}
    for reading in telemetry_selectors.first_readings(ids, MOST_READINGS + 1):
        readings.setdefault(reading.file_id, []).append(reading)
    made: dict[UUID | None, list[File]] = {}
    for file in telemetry_selectors.series_of(ids):
        made.setdefault(file.made_from_id, []).append(file)
    facts = tuple(
        _fact(row, when[row.pk], readings.get(row.pk, []), made.get(row.pk, [])) for row in rows
    )
    return facts, any(len(found) > MOST_READINGS for found in readings.values())


def _fact(
    row: File, moment: Moment, readings: Sequence[Reading], made: Sequence[File]
) -> MeasurementFact:
    return MeasurementFact(
        id=str(row.pk),
        seq=moment.seq,
        at=iso(moment.at) or "",
        clue=moment.clue,
        name=row.name,
        format=row.format,
        media_type=row.media_type,
        size_bytes=row.size_bytes,
        sha256=row.sha256,
        resource_id=_text(row.resource_id),
        device_id=_text(row.device_id),
        job_id=_text(row.job_id),
        kept_by_id=_text(row.kept_by_id),
        readings=[_reading(one) for one in readings[:MOST_READINGS]],
        made=[_series(file) for file in made],
    )


def _reading(row: Reading) -> ReadingFact:
    return ReadingFact(
        id=str(row.pk),
        name=row.name,
        quantity=row.quantity,
        unit=row.unit,
        value=row.text or row.value,
        series=row.series,
        measured_at=iso(row.measured_at) or "",
    )


def _series(row: File) -> FileFact:
    return FileFact(
        id=str(row.pk),
        name=row.name,
        run_id="",
        media_type=row.media_type,
        size_bytes=row.size_bytes,
        sha256=row.sha256,
    )


def _text(value: UUID | None) -> str:
    return "" if value is None else str(value)
