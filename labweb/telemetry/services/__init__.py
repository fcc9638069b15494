"""Writes of what was measured: samples that fade, files and readings that stay."""

from __future__ import annotations

from labweb.telemetry.services.device_photos import MOST_PHOTO_BYTES, keep_photo
from labweb.telemetry.services.incoming_files import (
    READ_TASK,
    arrive,
    await_file,
    bring,
    note_lost,
    read_incoming,
    ring_incoming,
)
from labweb.telemetry.services.kept_files import (
    PARQUET,
    Upload,
    check_links,
    keep_file,
    keep_picture,
)
from labweb.telemetry.services.plot_points import drawn
from labweb.telemetry.services.roll_ups import MOST_TRIMMED, roll_up, trim
from labweb.telemetry.services.samples import SILENT_S, take_in
from labweb.telemetry.services.telemetry_export import (
    MOST_ROWS,
    WantedSeries,
    write_csv,
    write_parquet,
)

__all__ = [
    "MOST_PHOTO_BYTES",
    "MOST_ROWS",
    "MOST_TRIMMED",
    "PARQUET",
    "READ_TASK",
    "SILENT_S",
    "Upload",
    "WantedSeries",
    "arrive",
    "await_file",
    "bring",
    "check_links",
    "drawn",
    "keep_file",
    "keep_photo",
    "keep_picture",
    "note_lost",
    "read_incoming",
    "ring_incoming",
    "roll_up",
    "take_in",
    "trim",
    "write_csv",
    "write_parquet",
]
