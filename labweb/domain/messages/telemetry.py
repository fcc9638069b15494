"""Samples on their way up, and what is known to be missing among them.

Source:
    The project's own; JSON over the uplink.
"""

from __future__ import annotations

from typing import Any

import msgspec

MAX_SAMPLES_PER_FRAME = 2000


class TelemetryGap(msgspec.Struct, frozen=True, kw_only=True):
    """Samples of some devices that were taken, or may have been, and will never come."""

    device_ids: list[str]
    since_s: float
    """Wall clock of the host: the last sample before the gap."""

    until_s: float
    """The first sample after it."""

    lost_count: int | None
    """How many, over all the devices together; None: nobody knows."""

    reason: str
    """`overflow` (too many waited for the server), `restart` (the process of the line began
    anew), `too_large` (more than a frame may hold)."""


class TelemetryFrame(msgspec.Struct, frozen=True, tag="telemetry", tag_field="t", kw_only=True):
    """Samples since the last frame. What is lost among them is told as a gap."""

    epoch: int
    samples: list[tuple[str, str, float, Any]]
    """(device id, status, seconds since the Unix epoch, value): by the server's clock, as the host
    had measured it when it read the value; before it has measured, by its own."""

    uncertainties_s: list[float | None] = msgspec.field(default_factory=list)
    """Of each sample: at most so far is its time wrong; None: nobody had measured."""

    lost_count: int = 0
    gaps: list[TelemetryGap] = msgspec.field(default_factory=list)
    key: str = ""
    """Place in the host's stream after these samples; the server says it back when it has
    stored them. Empty: the host does not wait for that."""


class TelemetryTaken(
    msgspec.Struct, frozen=True, tag="telemetry_taken", tag_field="t", kw_only=True
):
    """Everything up to `key` is stored, or its gap is."""

    key: str
