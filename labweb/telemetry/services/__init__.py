"""Writes of what was measured: samples that fade, files and readings that stay."""

from __future__ import annotations

from labweb.telemetry.services.drawing import drawn
from labweb.telemetry.services.files import Upload, check_links, keep_file
from labweb.telemetry.services.samples import KEEP_S, SILENT_S, take_in, trim

__all__ = ["KEEP_S", "SILENT_S", "Upload", "check_links", "drawn", "keep_file", "take_in", "trim"]
