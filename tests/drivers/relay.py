"""A wire between driver and server that can be cut, made silent and made noisy."""

from __future__ import annotations

import selectors
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

LOOK_S = 0.02


class Relay:
    """Carries bytes both ways; what comes from the server may be lost or changed."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(LOOK_S)
        self.port = int(self._listener.getsockname()[1])
        self.change: Callable[[bytes], bytes] = lambda data: data
        """What becomes of the server's bytes; b"" loses them."""

        self.when_sent: Callable[[bytes], None] = lambda _: None
        """Is shown the driver's bytes right before the server gets them."""

        self._is_cut = False
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._accept)
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self._carriers: list[threading.Thread] = []
        self._thread.start()

    def silence(self) -> None:
        """Lose every answer from here on."""
        self.change = lambda _: b""

    def cut(self) -> None:
        """Hang up, and let nobody through any more."""
        self._is_cut = True
        self._hang_up()

    def close(self) -> None:
        self._is_over.set()
        self._hang_up()
        for thread in [self._thread, *self._carriers]:
            thread.join(5)
        self._listener.close()

    def _hang_up(self) -> None:
        for pair in self._pairs:
            for one in pair:
                with suppress(OSError):
                    one.shutdown(socket.SHUT_RDWR)

    def _accept(self) -> None:
        while not self._is_over.is_set():
            try:
                client, _ = self._listener.accept()
            except TimeoutError:
                continue
            if self._is_cut:
                client.close()
                continue
            pair = (client, socket.create_connection(("127.0.0.1", self._port)))
            self._pairs.append(pair)
            carrier = threading.Thread(target=self._carry, args=pair)
            self._carriers.append(carrier)
            carrier.start()

    def _carry(self, client: socket.socket, server: socket.socket) -> None:
        with client, server, selectors.DefaultSelector() as waiting, suppress(OSError):
            waiting.register(client, selectors.EVENT_READ, server)
            waiting.register(server, selectors.EVENT_READ, client)
            while not self._is_over.is_set():
                for key, _ in waiting.select(LOOK_S):
                    assert isinstance(key.fileobj, socket.socket)
                    data = key.fileobj.recv(65_536)
                    if not data:
                        return
                    if key.fileobj is client:
                        self.when_sent(data)
                    else:
                        data = self.change(data)
                    key.data.sendall(data)


@contextmanager
def relayed(port: int) -> Iterator[Relay]:
    """Stand between a driver and the server at a port."""
    relay = Relay(port)
    try:
        yield relay
    finally:
        relay.close()
