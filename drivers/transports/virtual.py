"""The carrier of a device that has no wire: a timer, a computing node."""

from __future__ import annotations

from typing import ClassVar

from drivers.transports.base import Transport


class VirtualTransport(Transport):
    """A line without bytes. It still has one owner and a name."""

    sort: ClassVar[str] = "virtual"

    def __init__(self, url: str) -> None:
        super().__init__(url, url)
        self._is_open = False

    @property
    def is_open(self) -> bool:
        """Tell whether somebody holds it."""
        return self._is_open

    def _open(self) -> None:
        self._is_open = True

    def _close(self) -> None:
        self._is_open = False
