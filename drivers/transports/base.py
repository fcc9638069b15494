"""What every transport promises: one owner, one exchange at a time, bounded reads."""

from __future__ import annotations

import re
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import ClassVar, Literal

from labweb.domain.errors import (
    DefinitionError,
    DeviceTimeoutError,
    Effect,
    FrameError,
    UnreachableError,
)

Direction = Literal["out", "in"]
Observer = Callable[[Direction, bytes], None]
Ending = bytes | re.Pattern[bytes] | Callable[[bytes], int | None]
"""How a reply ends: with a terminator, where the pattern of a whole frame does, or at the length
that its first bytes tell. The function takes what has come and returns the length of the whole
reply, None while that is too little."""

MAX_FRAME_BYTES = 4096
"""Longest reply that is read; a longer one is noise."""

QUIET_S = 0.05
"""A line that has been silent this long owes no late answer."""

MAX_DRAIN_S = 1.0
"""Longest time spent waiting for a talking line to fall silent."""

LISTEN_S = 0.1
"""How often a wait that may be given up looks whether it should be."""

OPEN_TIMEOUT_S = 3.0
"""Longest time to open a line."""

_claims: dict[str, int] = {}
_claims_lock = threading.Lock()


class Transport(ABC):
    """One line. Drivers of devices on the same line share one object."""

    sort: ClassVar[str]
    """`byte`, `register` or `virtual`."""

    def __init__(self, url: str, line: str) -> None:
        self.url = url
        self.line = line
        """What is shared: two URLs with the same line are the same wire."""

        self.lock = threading.RLock()
        """Held for one exchange; hold it longer to keep several together."""

        self.observer: Observer | None = None
        """Called right before each write and after each read, with the bytes."""

        self._users: set[int] = set()

    @property
    @abstractmethod
    def is_open(self) -> bool:
        """Tell whether the line is open."""

    @abstractmethod
    def _open(self) -> None:
        """Open the operating system's handle."""

    @abstractmethod
    def _close(self) -> None:
        """Close the operating system's handle, if any."""

    def open(self) -> None:
        """Open the line; nothing happens when it is open.

        Raises:
            UnreachableError: It cannot be opened, or somebody else holds it; effect NONE.
        """
        with self.lock:
            if self.is_open:
                return
            _claim(self.line, id(self))
            try:
                self._open()
            except BaseException:
                _release(self.line, id(self))
                raise

    def close(self) -> None:
        """Close the line for all its drivers. May be called twice."""
        with self.lock:
            self._users.clear()
            try:
                self._close()
            finally:
                _release(self.line, id(self))

    def acquire(self, user: object) -> None:
        """Open the line on behalf of one driver.

        Raises:
            UnreachableError: As `open`.
        """
        with self.lock:
            self.open()
            self._users.add(id(user))

    def release(self, user: object) -> None:
        """Close the line when no other driver uses it."""
        with self.lock:
            if id(user) not in self._users:
                return
            self._users.discard(id(user))
            if not self._users:
                self.close()

    def for_url(self, url: str) -> Transport:
        """Return the transport for another device on this line.

        Raises:
            DefinitionError: The URL names other settings than those the line has.
        """
        if url != self.url:
            raise DefinitionError(
                f"{self.line} has the settings of {self.url}; {url} differs",
                code="transport.settings_differ",
            )
        return self

    def _observe(self, direction: Direction, data: bytes) -> None:
        if self.observer is not None:
            self.observer(direction, data)

    def _require_open(self) -> None:
        if not self.is_open:
            raise UnreachableError(
                "the line is not open: connect again",
                effect=Effect.NONE,
                context={"line": self.line},
            )


class ByteTransport(Transport):
    """A line that carries bytes: serial port, TCP socket."""

    sort: ClassVar[str] = "byte"

    def __init__(self, url: str, line: str) -> None:
        super().__init__(url, line)
        self.also: tuple[ByteTransport, ...] = ()
        """Further connections to the same device, which open and close with this one."""

        self.has_session = False
        """What is set up counts for one connection alone: it is never exchanged for another."""

        self.share: Transport | None = None
        """Where the files of the same device are read. It opens at the first file that is asked
        for, so that a device can be halted while the computer with its files is off."""

        self._may_owe_bytes = False
        self._has_failed = False
        """The last answer did not come, and nobody gave it up: nobody knows when it will."""

        self._last_used_s = float("-inf")

    @abstractmethod
    def _put(self, data: bytes) -> None:
        """Write all bytes."""

    @abstractmethod
    def _take(self, timeout_s: float) -> bytes:
        """Read what is there, waiting for at most the timeout; b"" when silent."""

    def exchange(
        self,
        request: bytes,
        *,
        until: Ending,
        timeout_s: float,
        gap_s: float = 0.0,
        longest_bytes: int = MAX_FRAME_BYTES,
    ) -> bytes:
        """Send a request and return the reply up to and with its end.

        Input that was waiting before is thrown away, and so is what follows the end.

        Args:
            request: All bytes of it.
            until: How the reply ends.
            timeout_s: Longest time to wait for the whole reply.
            gap_s: Least time since the line was last used, for instruments that lose what
                comes too soon.
            longest_bytes: A longer reply is noise.

        Raises:
            UnreachableError: Line closed or broken; NONE before the first byte, else UNKNOWN.
            DeviceTimeoutError: No whole reply in time; UNKNOWN.
            FrameError: Longer than is allowed; UNKNOWN.
        """
        with self.lock:
            self._write(request, gap_s)
            return self.receive(until=until, timeout_s=timeout_s, longest_bytes=longest_bytes)

    def receive(
        self,
        *,
        until: Ending,
        timeout_s: float,
        longest_bytes: int = MAX_FRAME_BYTES,
        unless: Callable[[], bool] | None = None,
    ) -> bytes:
        """Return the reply to what was sent before; hold the lock from the one to the other.

        Args:
            until: How the reply ends.
            timeout_s: Longest wait.
            longest_bytes: A longer reply is noise.
            unless: Gives the wait up early, as a timeout, once it is true.

        Raises:
            UnreachableError, DeviceTimeoutError, FrameError: As `exchange`; UNKNOWN.
        """
        with self.lock:
            self._may_owe_bytes = self._has_failed = True
            deadline_s = time.monotonic() + timeout_s
            reply = self._read(until, deadline_s, longest_bytes, unless)
            self._may_owe_bytes = self._has_failed = False
            self._last_used_s = time.monotonic()
            return reply

    def send(self, data: bytes, *, gap_s: float = 0.0) -> None:
        """Send bytes that have no reply, or one that `receive` waits for.

        Raises:
            UnreachableError: Line closed or broken; NONE before the first byte, else UNKNOWN.
        """
        with self.lock:
            self._write(data, gap_s)

    def keep_alive(self, payload: bytes, every_s: float) -> None:
        """Tell a device's watchdog that somebody is there; nothing where the URL names no place."""

    def _write(self, data: bytes, gap_s: float) -> None:
        self._require_open()
        threading.Event().wait(max(0.0, self._last_used_s + gap_s - time.monotonic()))
        with self._broken(Effect.NONE):
            self._drain()
        self._observe("out", data)
        with self._broken(Effect.UNKNOWN):
            self._put(data)
        self._last_used_s = time.monotonic()

    def _read(
        self,
        until: Ending,
        deadline_s: float,
        longest_bytes: int,
        unless: Callable[[], bool] | None = None,
    ) -> bytes:
        buffer = bytearray()
        while (length := whole_length(bytes(buffer), until)) is None or length > len(buffer):
            left_s = deadline_s - time.monotonic()
            if unless is not None and left_s > 0:
                self._has_failed = not unless()
                left_s = min(left_s, LISTEN_S if self._has_failed else 0.0)
            if left_s <= 0:
                raise DeviceTimeoutError(
                    "no whole answer in time",
                    context={"line": self.line, "received": bytes(buffer).hex()},
                )
            with self._broken(Effect.UNKNOWN):
                part = self._take(left_s)
            if part:
                self._observe("in", part)
            buffer += part
            if max(len(buffer), length or 0) > longest_bytes:
                raise FrameError(
                    f"answer of more than {longest_bytes} bytes", context={"line": self.line}
                )
        return bytes(buffer[:length])

    def _drain(self) -> None:
        """Throw away waiting input; after a failed exchange, also what still arrives."""
        quiet_s = QUIET_S if self._may_owe_bytes else 0.0
        deadline_s = time.monotonic() + MAX_DRAIN_S
        while part := self._take(quiet_s):
            self._observe("in", part)
            if time.monotonic() > deadline_s:
                raise FrameError(
                    "the line does not fall silent",
                    effect=Effect.NONE,
                    context={"line": self.line},
                )

    @contextmanager
    def _broken(self, effect: Effect) -> Iterator[None]:
        """Turn the vendor's errors into ours, and close the handle that failed."""
        try:
            yield
        except OSError as error:
            self._close()
            raise UnreachableError(
                f"the line broke: {error}", effect=effect, context={"line": self.line}
            ) from error


def whole_length(received: bytes, until: Ending) -> int | None:
    r"""Tell how long the reply is that starts what has come; None: not known yet.

    Example:
        >>> whole_length(b"ok\rnoise", b"\r"), whole_length(b"\xcc12", re.compile(rb"\xcc.{3}"))
        (3, None)
    """
    if isinstance(until, re.Pattern):
        found = until.search(received)
        return None if found is None else found.end()
    if callable(until):
        return until(received)
    at = received.find(until)
    return at + len(until) if at >= 0 else None


def _claim(line: str, owner: int) -> None:
    with _claims_lock:
        holder = _claims.setdefault(line, owner)
    if holder != owner:
        raise UnreachableError(
            f"{line} is already open in this process: share its transport", effect=Effect.NONE
        )


def _release(line: str, owner: int) -> None:
    with _claims_lock:
        if _claims.get(line) == owner:
            del _claims[line]
