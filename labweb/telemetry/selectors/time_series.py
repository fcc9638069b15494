"""Reads of what a device told over a time, as finely as it is asked for and no finer."""

from __future__ import annotations

import json
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from django.conf import settings
from django.db import connection

from labweb.domain.telemetry_resolution import MOST_POINTS, RAW, choose_resolution
from labweb.telemetry.models import Gap

RAW_WITHIN_S = 6 * 3600.0
"""In longer ranges nobody looks for single samples."""

MOST_GAPS = 1000

_NUMERIC = """
WITH RECURSIVE known(status) AS (
    SELECT min(status) FROM telemetry_rollup WHERE device_id = %(device)s
    UNION ALL
    SELECT (
        SELECT min(status) FROM telemetry_rollup
        WHERE device_id = %(device)s AND status > known.status
    ) FROM known WHERE known.status IS NOT NULL
)
SELECT status FROM known WHERE status IS NOT NULL
"""

_TOLD = """
WITH RECURSIVE known(status) AS (
    SELECT min(status) FROM telemetry_sample WHERE device_id = %(device)s
    UNION ALL
    SELECT (
        SELECT min(status) FROM telemetry_sample
        WHERE device_id = %(device)s AND status > known.status
    ) FROM known WHERE known.status IS NOT NULL
)
SELECT status FROM known WHERE status IS NOT NULL
"""

_RAW = """
WITH RECURSIVE known(status) AS (
    SELECT min(status) FROM telemetry_sample WHERE device_id = %(device)s
    UNION ALL
    SELECT (
        SELECT min(status) FROM telemetry_sample
        WHERE device_id = %(device)s AND status > known.status
    ) FROM known WHERE known.status IS NOT NULL
)
SELECT known.status, told.at, told.value FROM known CROSS JOIN LATERAL (
    SELECT at, value FROM telemetry_sample
    WHERE device_id = %(device)s AND status = known.status
    AND at >= %(since)s AND at <= %(until)s ORDER BY at LIMIT %(most)s
) AS told
WHERE %(statuses)s::text[] IS NULL OR known.status = ANY(%(statuses)s)
ORDER BY known.status, told.at
"""

_BUCKETS = """
SELECT status, floor(at / %(step)s) * %(step)s AS bucket,
    sum(mean * count) / sum(count), min(low), max(high), sum(count)::bigint
FROM telemetry_rollup
WHERE device_id = %(device)s AND status = ANY(%(statuses)s) AND level_s = %(level)s
    AND at >= floor(%(since)s / %(step)s) * %(step)s AND at <= %(until)s
GROUP BY status, bucket ORDER BY status, bucket
"""

_THINNED = """
SELECT DISTINCT ON (status, floor(at / %(step)s)) status, at, value FROM telemetry_sample
WHERE device_id = %(device)s AND status = ANY(%(statuses)s) AND at >= %(since)s AND at <= %(until)s
ORDER BY status, floor(at / %(step)s), at
"""


@dataclass(frozen=True, slots=True)
class Curve:
    """One status over a range, oldest first."""

    level_s: int
    """Width of the buckets that were read; 0: these are the samples themselves."""

    step_s: int
    """Width of the buckets that are told; 0: samples."""

    points: list[tuple[Any, ...]]
    """(seconds, value) of samples, or (begin, mean, lowest, highest, count) of buckets."""


def told_statuses(device_id: UUID) -> list[str]:
    """Return the names of the statuses of which anything is kept; in order."""
    return sorted({*_names(_TOLD, device_id), *_names(_NUMERIC, device_id)})


def _names(query: str, device_id: UUID) -> list[str]:
    with connection.cursor() as cursor:
        cursor.execute(query, {"device": device_id})
        return [status for (status,) in cursor.fetchall()]


def curves(
    device_id: UUID,
    since: float,
    until: float,
    *,
    points: int = MOST_POINTS,
    statuses: Collection[str] | None = None,
) -> dict[str, Curve]:
    """Return each status within the range: its samples where they fit, else its buckets.

    Args:
        device_id: Who told it.
        since: Begin, seconds since the Unix epoch.
        until: End, above `since`.
        points: How many each curve may have, `1 ≤ points ≤ MOST_POINTS`.
        statuses: Which; None: all.

    Returns:
        By status. Of yes-or-no, buckets tell the share of yes; a text is there only while its
        samples fit. At most four queries.
    """
    at = time.time()
    found: dict[str, Curve] = {}
    is_raw_kept = since >= at - settings.TELEMETRY_KEEP_S[RAW]
    if is_raw_kept and until - since <= RAW_WITHIN_S:
        found = _samples(device_id, since, until, points, statuses)
    asked = _names(_NUMERIC, device_id) if statuses is None else list(statuses)
    rest = [status for status in asked if status not in found]
    return found | _buckets(device_id, since, until, points, rest)


def _samples(
    device_id: UUID, since: float, until: float, points: int, statuses: Collection[str] | None
) -> dict[str, Curve]:
    """Return the samples of each status that has no more than may be told."""
    told: dict[str, list[tuple[Any, ...]]] = {}
    with connection.cursor() as cursor:
        cursor.execute(
            _RAW,
            {
                "device": device_id,
                "since": since,
                "until": until,
                "most": points + 1,
                "statuses": None if statuses is None else list(statuses),
            },
        )
        for status, at, value in cursor.fetchall():
            told.setdefault(status, []).append((at, json.loads(value)))
    return {
        status: Curve(0, 0, samples) for status, samples in told.items() if len(samples) <= points
    }


def _buckets(
    device_id: UUID, since: float, until: float, points: int, statuses: Sequence[str]
) -> dict[str, Curve]:
    if not statuses:
        return {}
    chosen = choose_resolution(
        since, until, points, now_s=time.time(), kept_s=settings.TELEMETRY_KEEP_S
    )
    found: dict[str, Curve] = {}
    with connection.cursor() as cursor:
        cursor.execute(
            _BUCKETS,
            {
                "device": device_id,
                "statuses": list(statuses),
                "level": chosen.level_s,
                "step": float(chosen.step_s),
                "since": since,
                "until": until,
            },
        )
        for status, *point in cursor.fetchall():
            curve = found.setdefault(status, Curve(chosen.level_s, chosen.step_s, []))
            curve.points.append(tuple(point))
    return found


def gaps(device_id: UUID, since: float, until: float) -> list[dict[str, Any]]:
    """Return the times within the range in which samples are known to be lost; oldest first.

    At most `MOST_GAPS`, the newest.
    """
    rows = Gap.objects.filter(device_id=device_id, since__lte=until, until__gte=since)
    newest = rows.order_by("-since", "-until", "-id")[:MOST_GAPS]
    fields = ("since", "until", "lost_count", "reason")
    return [dict(zip(fields, row, strict=True)) for row in newest.values_list(*fields)][::-1]


def series(device_id: UUID, since: float, until: float) -> dict[str, list[tuple[float, Any]]]:
    """Return (seconds, value) by status within the window, oldest first.

    Where a status has more than `MOST_POINTS` samples, its numbers are means of buckets, and of
    other values each is the first of its part of the window.
    """
    if not since < until:
        return {}
    found = curves(device_id, since, until)
    told = {
        status: [(point[0], point[1]) for point in curve.points] for status, curve in found.items()
    }
    others = [status for status in _names(_TOLD, device_id) if status not in told]
    if others:
        told |= _thinned(device_id, since, until, others)
    return dict(sorted(told.items()))


def _thinned(
    device_id: UUID, since: float, until: float, statuses: Sequence[str]
) -> dict[str, list[tuple[float, Any]]]:
    found: dict[str, list[tuple[float, Any]]] = {}
    with connection.cursor() as cursor:
        cursor.execute(
            _THINNED,
            {
                "device": device_id,
                "statuses": list(statuses),
                "since": since,
                "until": until,
                "step": (until - since) / MOST_POINTS,
            },
        )
        for status, at, value in cursor.fetchall():
            found.setdefault(status, []).append((at, json.loads(value)))
    return found
