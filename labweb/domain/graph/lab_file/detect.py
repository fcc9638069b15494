"""Tell the formats of lab files apart by what is in them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from labweb.domain.graph.lab_file.guard import decode_json
from labweb.domain.graph.lab_file.model import LabFile
from labweb.domain.graph.lab_file.read import read_decoded
from labweb.domain.graph.lab_file.uni_lab_os.reader import read_uni_lab_os


class Format(StrEnum):
    """A format of lab files."""

    LABWEB = "labweb"
    """labweb's own `lab.json`."""

    UNI_LAB_OS = "uni_lab_os"
    """Node-link graph of Uni-Lab-OS."""


class Document:
    """A lab file that was decoded once, and whose format is known."""

    def __init__(self, raw: bytes, name: str) -> None:
        """Decode a file; `name` is used where it has none.

        Raises:
            LabFileError: The file is no JSON that is read at all.
        """
        self._raw, self._name = raw, name
        self._value = decode_json(raw)
        value = self._value
        is_ours = isinstance(value, Mapping) and "schema" in value and "nodes" not in value
        self.format = Format.LABWEB if is_ours else Format.UNI_LAB_OS

    def read(self) -> LabFile:
        """Read it by the reader that should take it, or says best why it cannot.

        Raises:
            LabFileError: As the reader of its format.
        """
        if self.format is Format.LABWEB:
            return read_decoded(self._value)
        return read_uni_lab_os(self._raw, self._name)


def detect(raw: bytes) -> Format:
    """Choose the format whose reader should take the file, or say best why it cannot.

    Raises:
        LabFileError: The file is no JSON that is read at all.
    """
    return Document(raw, "").format


def read_any(raw: bytes, name: str) -> LabFile:
    """Read a lab file of either format; `name` is used where the file has none.

    Raises:
        LabFileError: As the reader of its format.
    """
    return Document(raw, name).read()
