"""Reads of samples, files and readings."""

from __future__ import annotations

from labweb.telemetry.models import File, Incoming, Reading
from labweb.telemetry.selectors.curves import (
    Curve,
    curves,
    gaps,
    series,
    told_statuses,
)
from labweb.telemetry.selectors.files import (
    files_about,
    files_of,
    files_of_device,
    files_of_jobs,
    find_file,
    find_incoming,
    find_reading,
    first_readings,
    measured_at,
    path_of,
    readings_of,
    readings_of_jobs,
    series_about,
    series_of,
    visible_files,
    visible_incoming,
    visible_readings,
)
from labweb.telemetry.selectors.samples import last_samples, latest, latest_of, samples

__all__ = [
    "Curve",
    "File",
    "Incoming",
    "Reading",
    "curves",
    "files_about",
    "files_of",
    "files_of_device",
    "files_of_jobs",
    "find_file",
    "find_incoming",
    "find_reading",
    "first_readings",
    "gaps",
    "last_samples",
    "latest",
    "latest_of",
    "measured_at",
    "path_of",
    "readings_of",
    "readings_of_jobs",
    "samples",
    "series",
    "series_about",
    "series_of",
    "told_statuses",
    "visible_files",
    "visible_incoming",
    "visible_readings",
]
