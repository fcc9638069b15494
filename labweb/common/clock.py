"""The real clock and the real source of identities."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from uuid import UUID

from labweb.domain.messages.commands import Tick
from labweb.domain.runs.host_link.host_clocks import Happened

_told: ContextVar[Happened | None] = ContextVar("told", default=None)


class SystemClock:
    """`labweb.domain.clock_and_ids.Clock` on this machine."""

    def now_s(self) -> float:
        """Return seconds since the Unix epoch."""
        return time.time()

    def monotonic_s(self) -> float:
        """Return seconds on a clock that never jumps."""
        return time.monotonic()

    def wait(self, duration_s: float) -> None:
        """Block for the duration."""
        threading.Event().wait(duration_s)


def tick() -> Tick:
    """Return this moment by a clock that nobody sets, the same in all processes of this machine.

    Source:
        clock_gettime(2), CLOCK_BOOTTIME; random(4), `boot_id`.
    """
    return Tick(clock=_boot_id(), at_s=time.clock_gettime(time.CLOCK_BOOTTIME))


@cache
def _boot_id() -> str:
    return Path("/proc/sys/kernel/random/boot_id").read_text("ascii").strip()


def now() -> datetime:
    """Return the time for a record, UTC-aware."""
    return datetime.fromtimestamp(time.time(), tz=UTC)


@contextmanager
def telling(told: Happened) -> Iterator[None]:
    """Let what is written in this block be of the moment that a host tells of, not of now."""
    token = _told.set(told)
    try:
        yield
    finally:
        _told.reset(token)


def told() -> Happened | None:
    """Return the moment that a host tells of; None: what is written is the server's own act."""
    return _told.get()


def happened_at() -> datetime:
    """Return when that which is written happened: at the host that tells of it, or now."""
    found = _told.get()
    return now() if found is None else moment_of(found)


def moment_of(happened: Happened) -> datetime:
    """Return a time that a host told, for a record, UTC-aware."""
    return datetime.fromtimestamp(happened.at_s, tz=UTC)


def new_id() -> UUID:
    """Return a UUIDv7: sorts by the millisecond it was made in.

    Source:
        RFC 9562, section 5.7.
    """
    milliseconds = time.time_ns() // 1_000_000
    random = int.from_bytes(os.urandom(10), "big")
    value = (milliseconds & (1 << 48) - 1) << 80
    value |= 0x7 << 76
    value |= (random >> 68 & 0xFFF) << 64
    value |= 0b10 << 62
    value |= random & ((1 << 62) - 1)
    return UUID(int=value)
