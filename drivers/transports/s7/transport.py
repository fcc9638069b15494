"""A line to an S7 controller: data blocks over ISO on TCP, which PUT/GET has to be allowed for.

Nobody proves who he is on such a line, and nothing is encrypted. The library is imported when a
line is opened: other hosts lack it.

Source:
    RFC 1006 (ISO on TCP); S7 communication as python-snap7 3.3 speaks it.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import TYPE_CHECKING, ClassVar

from drivers.transports.base import Transport
from drivers.transports.tcp import tcp_line
from labweb.domain.errors import (
    DeviceError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    UnreachableError,
)

if TYPE_CHECKING:
    from drivers.transports.s7.link import S7Link

ANSWER_S = 3.0
COUNTER_BYTES = 2
COUNTS = 0x10000


class S7Transport(Transport):
    """One processor of one controller; requests go one at a time.

    After an answer that did not come in time, or cannot be read, the connection is made anew, so
    that what brings the device to its safe state can still be sent; the request is not sent a
    second time.
    """

    sort: ClassVar[str] = "s7"

    def __init__(self, url: str, host: str, port: int, rack: int, slot: int) -> None:
        super().__init__(url, tcp_line(host, port))
        self._place = (host, port, rack, slot)
        self._link: S7Link | None = None
        self._beat: _Beat | None = None

    @property
    def is_open(self) -> bool:
        """Tell whether the connection stands, as far as is known."""
        return self._link is not None and self._link.is_connected

    def _open(self) -> None:
        self._drop()
        try:
            module = import_module("drivers.transports.s7.link")
        except ImportError as error:
            text = f"{error}: this host lacks the extra edge-s7"
            raise UnreachableError(text, effect=Effect.NONE) from error
        link = module.S7Link(*self._place, ANSWER_S, self._show)
        link.open()
        self._link = link

    def _close(self) -> None:
        beat, self._beat = self._beat, None
        if beat is not None:
            beat.end()
        self._drop()

    def _drop(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def read(self, block: int, start: int, count: int) -> bytes:
        """Return bytes of a data block.

        Raises:
            UnreachableError: No connection (NONE), or it broke (UNKNOWN).
            DeviceTimeoutError: No answer in time; UNKNOWN.
            RejectedError: There is no such object, or it may not be read; NONE.
            FrameError: The answer cannot be read; UNKNOWN.
        """
        with self._asking() as link:
            return link.read(block, start, count)

    def write(self, block: int, start: int, data: bytes) -> None:
        """Write bytes of a data block in one frame.

        Raises:
            DeviceError: As `read`. RejectedError: it was not taken, and nothing changed.
        """
        with self._asking() as link:
            link.write(block, start, data)

    def keep_alive(self, block: int, start: int, every_s: float) -> None:
        """Count two bytes of a data block up every so often, for a controller that watches them.

        It goes on until the line is closed, or the process dies. A count that cannot be written
        is not reported: the controller misses it and does what it does then, which is what its
        watchdog is for.
        """
        with self.lock:
            if self._beat is None and self.is_open:
                self._beat = _Beat(self, block, start, every_s)

    def count_up(self, block: int, start: int) -> None:
        """Count two bytes of a data block up by one.

        Raises:
            DeviceError: As `write`.
        """
        with self.lock:
            count = int.from_bytes(self.read(block, start, COUNTER_BYTES), "big")
            self.write(block, start, ((count + 1) % COUNTS).to_bytes(COUNTER_BYTES, "big"))

    @contextmanager
    def _asking(self) -> Iterator[S7Link]:
        with self.lock:
            self._require_open()
            if self._link is None:
                raise UnreachableError("the line is not open: connect again", effect=Effect.NONE)
            try:
                yield self._link
            except (DeviceTimeoutError, FrameError):
                self._drop()
                with suppress(UnreachableError):
                    self._open()
                raise
            except UnreachableError:
                self._drop()
                raise

    def _show(self, is_sending: bool, data: bytes) -> None:  # noqa: FBT001 - the link's shape
        self._observe("out" if is_sending else "in", data)


class _Beat:
    """Counts up from its making on, until it is ended."""

    def __init__(self, transport: S7Transport, block: int, start: int, every_s: float) -> None:
        self._transport = transport
        self._address = (block, start)
        self._every_s = every_s
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Count no more; a count that is under way may still be written."""
        self._is_over.set()

    def _run(self) -> None:
        while not self._is_over.is_set():
            with suppress(DeviceError):
                self._transport.count_up(*self._address)
            self._is_over.wait(self._every_s)
