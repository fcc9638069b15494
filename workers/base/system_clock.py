"""The real clocks."""

from __future__ import annotations

import threading
import time


class HostClock:
    """The machine's clocks, as `labweb.domain.clock_and_ids.Clock` wants them."""

    def now_s(self) -> float:
        """Return seconds since the Unix epoch, for records."""
        return time.time()

    def monotonic_s(self) -> float:
        """Return seconds on the clock that decides."""
        return time.monotonic()

    def wait(self, duration_s: float) -> None:
        """Let the duration pass."""
        threading.Event().wait(max(0.0, duration_s))
