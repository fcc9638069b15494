"""Writes of what was measured: samples that fade, files and readings that stay."""

from __future__ import annotations

from labweb.telemetry.services.drawing import drawn
from labweb.telemetry.services.exporting import MOST_ROWS, Wanted, write_csv, write_parquet
from labweb.telemetry.services.files import (
    PARQUET,
    Upload,
    check_links,
    keep_file,
    keep_picture,
)
from labweb.telemetry.services.incoming import (
    READ_TASK,
    arrive,
    await_file,
    bring,
    note_lost,
    read_incoming,
    ring_incoming,
)
from labweb.telemetry.services.photos import MOST_PHOTO_BYTES, keep_photo
from labweb.telemetry.services.rolling import MOST_TRIMMED, roll_up, trim
from labweb.telemetry.services.samples import SILENT_S, take_in

__all__ = [
    "MOST_PHOTO_BYTES",
    "MOST_ROWS",
    "MOST_TRIMMED",
    "PARQUET",
    "READ_TASK",
    "SILENT_S",
    "Upload",
    "Wanted",
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
