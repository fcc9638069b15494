"""A TCP socket that carries an instrument's bytes."""

from __future__ import annotations

import select
import socket

from drivers.transports.base import MAX_FRAME_BYTES, OPEN_TIMEOUT_S, ByteTransport
from drivers.transports.beat import Beat
from labweb.domain.errors import Effect, UnreachableError


class TcpTransport(ByteTransport):
    """One connection to one address."""

    def __init__(
        self, url: str, host: str, port: int, *, beat: tuple[str, int] | None = None
    ) -> None:
        super().__init__(url, tcp_line(host, port))
        self._address = (host, port)
        self._beat_address = beat
        self._beat: Beat | None = None
        self._socket: socket.socket | None = None

    @property
    def is_open(self) -> bool:
        """Tell whether the connection stands."""
        return self._socket is not None

    def _open(self) -> None:
        try:
            opened = socket.create_connection(self._address, timeout=OPEN_TIMEOUT_S)
            opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError as error:
            raise UnreachableError(
                f"{self.line} cannot be opened: {error}", effect=Effect.NONE
            ) from error
        self._socket = opened

    def keep_alive(self, payload: bytes, every_s: float) -> None:
        """Send a datagram every so often to where the URL's `beat` says, while the line is open."""
        with self.lock:
            if self._beat_address is not None and self._beat is None and self.is_open:
                self._beat = Beat(self._beat_address, payload, every_s)

    def _close(self) -> None:
        beat, self._beat = self._beat, None
        if beat is not None:
            beat.end()
        opened, self._socket = self._socket, None
        if opened is not None:
            opened.close()

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


def tcp_line(host: str, port: int) -> str:
    """Name the wire behind an address."""
    return f"tcp:{host}:{port}"
