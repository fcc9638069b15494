"""When a host does something."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class HostMoment:
    """A moment by a host's own clocks."""

    boot_id: str
    mono_s: float
    """Monotonic within one boot."""

    wall_s: float
