"""What an observable tells: one stream, kept open, of which the last answer counts.

A stream for each question would cost a server a thread until its next answer, long after the
question was given up.
"""

from __future__ import annotations

import threading
import time
from typing import Any

import grpc  # type: ignore[import-untyped]


class StreamWatch:
    """Listens to one stream until it ends, or is ended."""

    def __init__(self, stream: Any) -> None:  # noqa: ANN401 - the library's class
        self._stream = stream
        self._news = threading.Condition()
        self._last: Any = None
        self._is_over = False
        self._error: grpc.RpcError | None = None
        threading.Thread(target=self._listen, daemon=True).start()

    def last(self, timeout_s: float) -> Any:  # noqa: ANN401 - a message
        """Return the last answer, waiting for the first; None: none came in time, or ever.

        Raises:
            grpc.RpcError: The stream broke.
        """
        deadline_s = time.monotonic() + timeout_s
        with self._news:
            while self._last is None and not self._is_over:
                if not self._news.wait(max(0.0, deadline_s - time.monotonic())):
                    break
            if self._error is not None:
                raise self._error
            return self._last

    @property
    def has_ended(self) -> bool:
        """Tell whether nothing more will come."""
        return self._is_over

    def end(self) -> None:
        """Listen no more."""
        self._stream.cancel()

    def _listen(self) -> None:
        try:
            for answer in self._stream:
                with self._news:
                    self._last = answer
                    self._news.notify_all()
        except grpc.RpcError as error:
            self._error = error
        with self._news:
            self._is_over = True
            self._news.notify_all()
