"""The frames in which a picture travels from an edge host to the server, and the answer."""

from __future__ import annotations

from uuid import UUID

import msgspec

MOST_BYTES = 4 * 2**20
"""Largest picture."""

PART_BYTES = 128 * 1024
"""So much of it goes into one frame."""

UNKNOWN = "picture.unknown"
"""Code of an answer: no event that the server knows names the picture; it may come later."""


class Picture(msgspec.Struct, frozen=True, tag="picture", tag_field="t", kw_only=True):
    """A part of a picture that a verdict or a reading of an action rests on."""

    epoch: int
    action_id: UUID
    device_id: UUID
    """The camera."""

    sha256: str
    offset_bytes: int
    size_bytes: int
    """Of the whole picture."""

    data: bytes


class PictureTaken(msgspec.Struct, frozen=True, tag="picture_taken", tag_field="t", kw_only=True):
    """What became of a picture whose last part has come."""

    action_id: UUID
    sha256: str
    code: str = ""
    """Empty: it is kept. Any other but `UNKNOWN`: it is not wanted, and need not come again."""


class PictureParts:
    """Puts the parts of one picture after another together; what does not fit begins anew."""

    def __init__(self) -> None:
        self._of: tuple[UUID, UUID, str, int] | None = None
        self._data = bytearray()

    def add(self, part: Picture) -> bytes | None:
        """Take a part; return the whole picture with its last one."""
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
