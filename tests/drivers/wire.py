"""The other end of a wire, for the transports: a socket that answers by a function."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Answer = Callable[[bytes], bytes | None]
"""From what came in to what goes out; None hangs up, b"" stays silent."""


@contextmanager
def answering(answer: Answer) -> Iterator[int]:
    """Serve one connection after another on a free port until the block ends."""
    listener = socket.create_server(("127.0.0.1", 0))
    listener.settimeout(0.05)
    is_over = threading.Event()
    thread = threading.Thread(target=_serve, args=(listener, answer, is_over))
    thread.start()
    try:
        yield listener.getsockname()[1]
    finally:
        is_over.set()
        thread.join(5)
        listener.close()


def _serve(listener: socket.socket, answer: Answer, is_over: threading.Event) -> None:
    while not is_over.is_set():
        try:
            connection, _ = listener.accept()
        except TimeoutError:
            continue
        with connection:
            _talk(connection, answer, is_over)


def _talk(connection: socket.socket, answer: Answer, is_over: threading.Event) -> None:
    connection.settimeout(0.05)
    while not is_over.is_set():
        try:
            request = connection.recv(4096)
        except TimeoutError:
            continue
        except OSError:
            return
        reply = answer(request) if request else None
        if reply is None:
            return
        connection.sendall(reply)
