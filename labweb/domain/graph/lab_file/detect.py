"""Tell the formats of lab files apart by what is in them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from labweb.domain.graph.lab_file.guard import decode_json
from labweb.domain.graph.lab_file.model import LabFile
from labweb.domain.graph.lab_file.read import read_lab
from labweb.domain.graph.lab_file.uni_lab_os.reader import read_uni_lab_os


class Format(StrEnum):
    """A format of lab files."""

    LABWEB = "labweb"
    """labweb's own `lab.json`."""

    UNI_LAB_OS = "uni_lab_os"
    """Node-link graph of Uni-Lab-OS."""


def detect(raw: bytes) -> Format:
    """Choose the format whose reader should take the file, or say best why it cannot.

    Raises:
        LabFileError: The file is no JSON that is read at all.
    """
    value = decode_json(raw)
    if isinstance(value, Mapping) and "schema" in value and "nodes" not in value:
        return Format.LABWEB
    return Format.UNI_LAB_OS


def read_any(raw: bytes, name: str) -> LabFile:
    """Read a lab file of either format; `name` is used where the file has none.

    Raises:
        LabFileError: As the reader of its format.
    """
    if detect(raw) is Format.LABWEB:
        return read_lab(raw)
    return read_uni_lab_os(raw, name)
