"""Find out when web answers."""

from __future__ import annotations

import http.client
import threading
from collections.abc import Callable

_POLL_S = 0.1
_TIMEOUT_S = 5.0
PATH = "/healthz"


class Health(threading.Thread):
    """Ask web until it answers 200, beside the supervisor's loop."""

    def __init__(self, host: str, port: int, on_answer: Callable[[], None]) -> None:
        """Prepare to ask; `start` begins."""
        super().__init__(name="health", daemon=True)
        self._address = (host, port)
        self._on_answer = on_answer
        self._answered = threading.Event()
        self._ended = threading.Event()

    def has_answered(self) -> bool:
        """Tell whether web has answered once."""
        return self._answered.is_set()

    def end(self) -> None:
        """Stop asking."""
        self._ended.set()

    def run(self) -> None:
        """Ask at short intervals until the first good answer."""
        while not self._ended.is_set():
            if self._ask():
                self._answered.set()
                self._on_answer()
                return
            self._ended.wait(_POLL_S)

    def _ask(self) -> bool:
        connection = http.client.HTTPConnection(*self._address, timeout=_TIMEOUT_S)
        try:
            connection.request("GET", PATH)
            return connection.getresponse().status == http.client.OK
        except (OSError, http.client.HTTPException):
            return False
        finally:
            connection.close()
