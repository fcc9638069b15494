"""The files of a device whose own protocol hands none over, read over HTTP from another port."""

from __future__ import annotations

from drivers.transports.base import ByteTransport, Direction
from drivers.transports.http import HttpTransport


class Share(HttpTransport):
    """A share beside a line: taken in turn with it, and seen by the same observer.

    Nobody is asked there before a file is wanted, and a file that cannot be had says nothing of
    the line beside it.
    """

    def __init__(self, owner: ByteTransport, host: str, port: int) -> None:
        super().__init__(owner.url, host, port)
        self.lock = owner.lock
        self._owner = owner

    def reach(self) -> None:
        """Make sure that somebody listens there now, before anything is begun that writes files.

        Raises:
            UnreachableError: Nobody does; effect NONE.
        """
        with self.lock:
            self.close()
            self.open()

    def _require_open(self) -> None:
        self.open()

    def _observe(self, direction: Direction, data: bytes) -> None:
        if self._owner.observer is not None:
            self._owner.observer(direction, data)
