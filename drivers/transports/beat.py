"""A datagram that is sent again and again, for devices that stop when nobody is there."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress


class DatagramBeat:
    """Sends from its making on, until it is ended or the process dies.

    A datagram that cannot be sent is not reported: the device misses it and does what it does
    then, which is what its watchdog is for.
    """

    def __init__(self, address: tuple[str, int], payload: bytes, every_s: float) -> None:
        self._address = address
        self._payload = payload
        self._every_s = every_s
        self._is_over = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Send no more. May be called twice."""
        self._is_over.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        while True:
            with suppress(OSError):
                self._send()
            if self._is_over.wait(self._every_s):
                return

    def _send(self) -> None:
        """Send once. The socket is connected, for only so is it known where a line sends."""
        self._socket.connect(self._address)
        # What became of the datagram before is no reason to leave this one out.
        self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        self._socket.send(self._payload)
