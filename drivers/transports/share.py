"""The files of a device whose own protocol hands none over, read over HTTP from another port."""

from __future__ import annotations

from drivers.transports.base import ByteTransport, Direction
from drivers.transports.http import HttpTransport


class Share(HttpTransport):
    """A share beside a line: taken in turn with it, and seen by the same observer."""

    def __init__(self, owner: ByteTransport, host: str, port: int) -> None:
        super().__init__(owner.url, host, port)
        self.lock = owner.lock
        self._owner = owner

    def _observe(self, direction: Direction, data: bytes) -> None:
        if self._owner.observer is not None:
            self._owner.observer(direction, data)
