"""Files that an action hands over: how they are named, bounded, and carried from host to server.

A file is either named in the report of an action, or it is the picture that a verdict rests on.
A host offers it, sends it when the server wants it, and forgets it once the server has it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from uuid import UUID

import msgspec

from labweb.domain.errors import Finding

MOST_BYTES = 64 * 2**20
"""Largest file that a host hands over."""

MOST_FILES = 16
"""Files that one action may hand over."""

MOST_NAME_SIGNS = 255

OTHER_MEDIA_TYPE = "application/octet-stream"
"""Of bytes of which nothing better is told."""

_MEDIA_TYPE = re.compile(r"[a-z0-9][a-z0-9!#$&^_.+-]{0,40}/[a-z0-9][a-z0-9!#$&^_.+-]{0,50}")
_SHA256 = re.compile(r"[0-9a-f]{64}")

PART_BYTES = 128 * 1024
"""So much of it goes into one frame."""

MEDIA_TYPES: Mapping[str, str] = MappingProxyType(
    {
        "csv": "text/csv",
        "xml": "application/xml",
        "mzml": "application/xml",
        "jcamp": "chemical/x-jcamp-dx",
        "andi": "application/x-netcdf",
        "neware": "application/octet-stream",
    }
)
"""By format that is read; a file that is only kept has the type that its sender tells."""

KEPT_ONLY = "none"
"""Format of a file of which nothing is read."""

WANTED = "file.wanted"
"""Code of an answer to an offer: send it."""

UNKNOWN = "file.unknown"
"""Code of an answer: no event that the server knows names the file; it may come later."""

LOST = "file.lost"
"""Code of a host: it has named the file, and does not have its bytes any more."""


class NamedFile(msgspec.Struct, frozen=True, kw_only=True):
    """A file as the report of an action names it."""

    name: str
    format: str
    """A key of `MEDIA_TYPES`, or `none`."""

    media_type: str
    size_bytes: int
    sha256: str


class FileOffer(msgspec.Struct, frozen=True, tag="file_offer", tag_field="t", kw_only=True):
    """A file waits on the host: does the server want it?"""

    epoch: int
    action_id: UUID
    device_id: UUID
    """Where it comes from: what measured, or the camera."""

    sha256: str
    size_bytes: int


class FilePart(msgspec.Struct, frozen=True, tag="file_part", tag_field="t", kw_only=True):
    """A part of a file that the server wants."""

    epoch: int
    action_id: UUID
    device_id: UUID
    sha256: str
    offset_bytes: int
    size_bytes: int
    """Of the whole file."""

    data: bytes


class FileTaken(msgspec.Struct, frozen=True, tag="file_taken", tag_field="t", kw_only=True):
    """What the server says of a file that is offered, or whose last part has come."""

    action_id: UUID
    sha256: str
    code: str = ""
    """Empty: it is kept. `WANTED`, `UNKNOWN`; any other: it need not be offered again."""


class FileAsked(msgspec.Struct, frozen=True, tag="file_asked", tag_field="t", kw_only=True):
    """The server waits for a file that an event names: does the host still have it?"""

    action_id: UUID
    device_id: UUID
    sha256: str


class FileGone(msgspec.Struct, frozen=True, tag="file_gone", tag_field="t", kw_only=True):
    """The host does not have the bytes of a file any more, though an event names it."""

    epoch: int
    action_id: UUID
    sha256: str
    message: str


class FileParts:
    """Puts the parts of one file after another together; what does not fit begins anew."""

    def __init__(self) -> None:
        self._of: tuple[UUID, UUID, str, int] | None = None
        self._data = bytearray()

    def add(self, part: FilePart) -> bytes | None:
        """Take a part; return the whole file with its last one."""
        whole = (part.action_id, part.device_id, part.sha256, part.size_bytes)
        if part.offset_bytes == 0:
            self._of, self._data = whole, bytearray()
        end = part.offset_bytes + len(part.data)
        is_next = self._of == whole and part.offset_bytes == len(self._data)
        if not is_next or not part.data or end > part.size_bytes or part.size_bytes > MOST_BYTES:
            self._of, self._data = None, bytearray()
            return None
        self._data += part.data
        if end < part.size_bytes:
            return None
        found = bytes(self._data)
        self._of, self._data = None, bytearray()
        return found


def check_files(files: Sequence[NamedFile]) -> list[Finding]:
    """List why files cannot be handed over; an empty list means that they can."""
    findings = []
    if len(files) > MOST_FILES:
        text = f"{len(files)} files; one action hands {MOST_FILES} over at most"
        findings.append(Finding("file.too_many", text))
    names, digests = [file.name for file in files], {file.sha256 for file in files}
    if len(digests) < len(files):
        findings.append(Finding("file.twice", "two files of one action have the same bytes"))
    for file in files:
        if not is_name(file.name) or names.count(file.name) > 1:
            text = f"{file.name[:80]!r} is no name of 1 to 255 printable signs, or comes twice"
            findings.append(Finding("file.name", text, file.name[:80]))
        if file.format not in {*MEDIA_TYPES, KEPT_ONLY}:
            known = ", ".join([*MEDIA_TYPES, KEPT_ONLY])
            text = f"{file.name[:80]}: format {file.format[:40]!r}; it is one of {known}"
            findings.append(Finding("file.format", text, file.name[:80]))
        if not _MEDIA_TYPE.fullmatch(file.media_type):
            text = f"{file.name[:80]}: {file.media_type[:40]!r} is no media type"
            findings.append(Finding("file.media_type", text, file.name[:80]))
        if not _SHA256.fullmatch(file.sha256):
            text = f"{file.name[:80]}: {file.sha256[:40]!r} is no SHA-256 in 64 hexadecimal digits"
            findings.append(Finding("file.digest", text, file.name[:80]))
        if file.size_bytes < 1:
            findings.append(Finding("file.empty", f"{file.name[:80]} is empty", file.name[:80]))
        if file.size_bytes > MOST_BYTES:
            text = f"{file.name[:80]} has {file.size_bytes} bytes; {MOST_BYTES} are handed over"
            findings.append(Finding("file.too_large", text, file.name[:80]))
    return findings


def plain_media_type(told: str) -> str:
    """Return a media type without its parameters, and that of plain bytes for what is none.

    Example:
        >>> plain_media_type("Text/CSV; charset=utf-8"), plain_media_type("a spectrum")
        ('text/csv', 'application/octet-stream')
    """
    plain = told.split(";")[0].strip().lower()
    return plain if _MEDIA_TYPE.fullmatch(plain) else OTHER_MEDIA_TYPE


def is_name(name: str) -> bool:
    """Tell whether a file can be shown and saved under a name.

    Example:
        >>> is_name("spectrum.dx"), is_name("../x"), is_name("")
        (True, False, False)
    """
    is_short = 0 < len(name) <= MOST_NAME_SIGNS
    return is_short and name.isprintable() and not set("/\\") & set(name) and name.strip(". ") != ""
