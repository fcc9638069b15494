"""Writes of samples and of what is missing among them, and the announcement to who watches."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any
from uuid import UUID

import msgspec
from django.conf import settings
from django.db import DataError, connection
from django.db.transaction import atomic

from labweb.common import feed
from labweb.domain.messages.telemetry import TelemetryGap
from labweb.domain.telemetry_resolution import RAW
from labweb.telemetry.models import Gap

logger = logging.getLogger(__name__)

SILENT_S = 5.0
"""After so long without a sample a device counts as silent."""

AHEAD_S = 86400.0
"""A sample whose host's clock is further ahead is refused: it would never fade."""

_LONGEST_STATUS = 64
_MOST_S = 1e11
_REASON_LENGTH = 16

_KEEP = """
WITH came AS (
    INSERT INTO telemetry_sample (device_id, status, at, value, uncertainty_s, received_at)
    SELECT device_id, status, at, value::jsonb, uncertainty_s, %s
    FROM unnest(%s::uuid[], %s::text[], %s::float8[], %s::text[], %s::float8[])
        AS told(device_id, status, at, value, uncertainty_s)
    ORDER BY device_id, status, at
    ON CONFLICT DO NOTHING
    RETURNING device_id, status, at, jsonb_typeof(value) AS kind
), cells AS (
    SELECT DISTINCT device_id, status, floor(at) AS at FROM came
    WHERE kind IN ('number', 'boolean')
)
INSERT INTO telemetry_mark (level_s, due_at, device_ids, statuses, ats)
SELECT 1, %s, array_agg(device_id), array_agg(status), array_agg(at)
FROM cells HAVING count(*) > 0
"""
"""Only what was not known marks its buckets: a batch that comes twice changes nothing."""

_last_heard: dict[str, float] = {}


@dataclass(slots=True)
class _Frame:
    """A frame taken apart."""

    device_ids: list[str] = field(default_factory=list)
    statuses: list[str] = field(default_factory=list)
    ats: list[float] = field(default_factory=list)
    values: list[str] = field(default_factory=list)
    uncertainties_s: list[float | None] = field(default_factory=list)
    shown: dict[str, list[list[Any]]] = field(default_factory=dict)
    refused: dict[tuple[str, str], list[float]] = field(default_factory=dict)
    """Times of samples that are not stored, by device and reason."""

    def refuse(self, device_id: str, reason: str, at: float) -> None:
        """Note a sample that is not stored."""
        self.refused.setdefault((device_id, reason), []).append(at)


def take_in(
    known: set[UUID],
    samples: Sequence[tuple[str, str, float, Any]],
    gaps: Iterable[TelemetryGap] = (),
    uncertainties_s: Sequence[float | None] = (),
) -> None:
    """Store a frame of samples and of gaps, and announce it.

    It may come twice, late or out of order: what is known already changes nothing. A sample
    that cannot be stored leaves a gap that says so, and the others are stored.

    Args:
        known: Devices of the host that sends; samples of others are dropped.
        samples: (device id, status, seconds since the Unix epoch, value).
        gaps: What the host knows to be missing.
        uncertainties_s: Of each sample, how far its time may be wrong; None: the host did not
            measure; none at all: it measures nothing.

    Effect:
        None on matter. Once it returns, every sample of a known device is stored or its gap is.
    """
    names = {str(device_id) for device_id in known}
    frame = _sorted(names, samples, uncertainties_s)
    lost = [_told(gap, device_id) for gap in gaps for device_id in gap.device_ids]
    with atomic():
        _keep(frame)
        _keep_gaps([gap for gap in lost if gap is not None and str(gap.device_id) in names])
        _keep_gaps(_refusals(frame))
    for device_id in frame.shown:
        _announce_return(device_id)
    feed.publish_all(
        [
            (f"telemetry:{device_id}", {"device_id": device_id, "samples": points})
            for device_id, points in frame.shown.items()
        ]
    )


def _sorted(
    names: set[str],
    samples: Sequence[tuple[str, str, float, Any]],
    uncertainties_s: Sequence[float | None],
) -> _Frame:
    at_s = time.time()
    oldest = at_s - settings.TELEMETRY_KEEP_S[RAW]
    frame = _Frame()
    known = zip_longest(samples, uncertainties_s[: len(samples)])
    for (device_id, status, at, value), uncertainty_s in known:
        if device_id not in names:
            continue
        text = msgspec.json.encode(value).decode()
        is_sound = 0 < len(status) <= _LONGEST_STATUS and "\0" not in status
        if not is_sound or not 0 <= at <= at_s + AHEAD_S or "\\u0000" in text:
            frame.refuse(device_id, "refused", at)
            continue
        if at < oldest:
            frame.refuse(device_id, "late", at)
            continue
        frame.device_ids.append(device_id)
        frame.statuses.append(status)
        frame.ats.append(at)
        frame.values.append(text)
        frame.uncertainties_s.append(uncertainty_s)
        frame.shown.setdefault(device_id, []).append([status, at, value])
    return frame


def _keep(frame: _Frame) -> None:
    """Store the samples of a frame; all of them are refused if the database cannot hold one."""
    if not frame.ats:
        return
    columns = (frame.device_ids, frame.statuses, frame.ats, frame.values, frame.uncertainties_s)
    at_s = time.time()
    try:
        with atomic(), connection.cursor() as cursor:
            cursor.execute(_KEEP, [at_s, *columns, at_s])
    except DataError as error:
        logger.warning("%d samples are refused: %s", len(frame.ats), error)
        for device_id, at in zip(frame.device_ids, frame.ats, strict=True):
            frame.refuse(device_id, "refused", at)
        frame.shown.clear()


def _refusals(frame: _Frame) -> list[Gap]:
    """Return a gap for each device and reason; a time that is none is told as the present."""
    found = []
    for (device_id, reason), ats in frame.refused.items():
        times = [at for at in ats if 0 <= at < _MOST_S] or [time.time()]
        gap = Gap(since=min(times), until=max(times), lost_count=len(ats), reason=reason)
        gap.device_id = UUID(device_id)
        found.append(gap)
    return found


def _told(told: TelemetryGap, device_id: str) -> Gap | None:
    """Return a gap as a host tells it, or None if it makes no sense."""
    is_sound = 0 <= told.since_s < _MOST_S and 0 <= told.until_s < _MOST_S
    if not is_sound or not told.reason or len(told.reason) > _REASON_LENGTH:
        return None
    since, until = sorted((told.since_s, told.until_s))
    count = None if told.lost_count is None else max(0, min(told.lost_count, 2**62))
    gap = Gap(since=since, until=until, lost_count=count, reason=told.reason.replace("\0", ""))
    try:
        gap.device_id = UUID(device_id)
    except ValueError:
        return None
    return gap


def _keep_gaps(gaps: Sequence[Gap]) -> None:
    if gaps:
        Gap.objects.bulk_create(gaps, ignore_conflicts=True)


def _announce_return(device_id: str) -> None:
    """Tell pages that a device speaks again, or for the first time."""
    at = time.monotonic()
    if at - _last_heard.get(device_id, -SILENT_S) >= SILENT_S:
        feed.publish("devices", {"device_id": device_id})
    _last_heard[device_id] = at
