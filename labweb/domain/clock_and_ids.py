"""What the core needs from outside: the time and fresh identities."""

from __future__ import annotations

from typing import Protocol
from uuid import UUID


class Clock(Protocol):
    """Two clocks in one: the wall for records, the monotonic one for decisions."""

    def now_s(self) -> float:
        """Return seconds since the Unix epoch, UTC. For records and display only."""
        ...

    def monotonic_s(self) -> float:
        """Return seconds on a clock that never jumps. For every decision."""
        ...

    def wait(self, duration_s: float) -> None:
        """Return after the duration; a test's clock returns at once and advances."""
        ...


class IdSource(Protocol):
    """Mints identities."""

    def new_id(self) -> UUID:
        """Return a fresh UUIDv7."""
        ...
