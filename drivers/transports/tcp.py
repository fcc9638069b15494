"""A TCP socket that carries an instrument's bytes."""

from __future__ import annotations

import select
import socket
from collections.abc import Sequence

from drivers.transports.base import (
    MAX_FRAME_BYTES,
    OPEN_TIMEOUT_S,
    QUIET_S,
    ByteTransport,
    Direction,
)
from drivers.transports.beat import DatagramBeat
from labweb.domain.errors import Effect, UnreachableError

RENEW_TIMEOUT_S = 0.5
"""Longest time to begin another connection while somebody waits for an exchange."""


class TcpTransport(ByteTransport):
    """One connection to one address, with those to further ports of the same device."""

    def __init__(
        self,
        url: str,
        host: str,
        port: int,
        *,
        beat: tuple[str, int] | None = None,
        also: Sequence[int] = (),
    ) -> None:
        super().__init__(url, tcp_line(host, port))
        self.also = tuple(_Side(self, host, one) for one in also)
        self._address = (host, port)
        self._beat_address = beat
        self._beat: DatagramBeat | None = None
        self._socket: socket.socket | None = None

    @property
    def is_open(self) -> bool:
        """Tell whether the connection stands, and those to further ports."""
        return self._socket is not None and all(one.is_open for one in self.also)

    def _open(self) -> None:
        self._close()
        self._has_failed = False
        try:
            self._socket = self._connect()
            for one in self.also:
                one.open()
        except OSError as error:
            self._close()
            raise UnreachableError(
                f"{self.line} cannot be opened: {error}", effect=Effect.NONE
            ) from error
        except UnreachableError:
            self._close()
            raise

    def keep_alive(self, payload: bytes, every_s: float) -> None:
        """Send a datagram every so often to where the URL's `beat` says, while the line is open."""
        with self.lock:
            if self._beat_address is not None and self._beat is None and self.is_open:
                self._beat = DatagramBeat(self._beat_address, payload, every_s)

    def _close(self) -> None:
        beat, self._beat = self._beat, None
        if beat is not None:
            beat.end()
        opened, self._socket = self._socket, None
        if opened is not None:
            opened.close()
        for one in self.also:
            one.close()
        if self.share is not None:
            self.share.close()

    def _drain(self) -> None:
        """Throw away what waits; after an answer that did not come, begin a new connection.

        A device that was held up answers when it goes on, and in some protocols nothing tells
        which request an answer is to. It then goes to the connection that is no more. Where
        no other one is let in, this one is kept: a word to halt has to go through.
        """
        if self._has_failed and not self.has_session:
            self._renew()
        super()._drain()

    def _renew(self) -> None:
        try:
            fresh = self._connect(RENEW_TIMEOUT_S)
        except OSError:
            return
        if _is_closed(fresh):
            fresh.close()
            return
        self._opened().close()
        self._socket = fresh
        self._has_failed = False

    def _connect(self, timeout_s: float = OPEN_TIMEOUT_S) -> socket.socket:
        opened = socket.create_connection(self._address, timeout=timeout_s)
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return opened

    def _put(self, data: bytes) -> None:
        self._opened().sendall(data)

    def _take(self, timeout_s: float) -> bytes:
        opened = self._opened()
        readable, _, _ = select.select([opened], [], [], max(0.0, timeout_s))
        if not readable:
            return b""
        data = opened.recv(MAX_FRAME_BYTES)
        if not data:
            raise ConnectionResetError("the other side closed the connection")
        return data

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise OSError("connection is closed")
        return self._socket


class _Side(TcpTransport):
    """A connection to a further port: of the line of its owner, and seen by the same observer."""

    def __init__(self, owner: TcpTransport, host: str, port: int) -> None:
        super().__init__(owner.url, host, port)
        self.lock = owner.lock
        self._owner = owner

    def _observe(self, direction: Direction, data: bytes) -> None:
        if self._owner.observer is not None:
            self._owner.observer(direction, data)


def _is_closed(fresh: socket.socket) -> bool:
    """Tell whether the other side takes no second connection, and hangs up at once."""
    readable, _, _ = select.select([fresh], [], [], QUIET_S)
    try:
        return bool(readable) and not fresh.recv(1, socket.MSG_PEEK)
    except OSError:
        return True


def tcp_line(host: str, port: int) -> str:
    """Name the wire behind an address."""
    return f"tcp:{host}:{port}"
