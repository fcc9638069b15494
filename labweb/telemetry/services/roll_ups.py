"""Roll-ups: samples into seconds, seconds into minutes, minutes into hours; and what fades."""

from __future__ import annotations

import time

from django.conf import settings
from django.db import connection
from django.db.transaction import atomic

from labweb.domain.telemetry_resolution import LEVELS_S, RAW, SLACK_S
from labweb.telemetry.models import Gap

_ROLLING_LOCK = 0x6C61_6265
"""Held by whoever rolls up: two would compute the same buckets."""

_MARKS_AT_ONCE = 50

_WAIT_S = {1: 0.0, 60: 10.0, 3600: 60.0}
"""How long what came into the buckets of a level gathers before they are computed."""

OVERDUE_S = 60.0

_OF_SAMPLES = """
    SELECT count(*)::bigint AS count, min(number) AS low, max(number) AS high, avg(number) AS mean
    FROM (
        SELECT CASE jsonb_typeof(value) WHEN 'number' THEN value::float8
            ELSE value::boolean::int::float8 END AS number FROM telemetry_sample
        WHERE device_id = cells.device_id AND status = cells.status
        AND at >= cells.at AND at < cells.at + 1
        AND jsonb_typeof(value) IN ('number', 'boolean') OFFSET 0
    ) AS within
"""
"""Yes counts 1 and no counts 0, so that the mean is the share of yes."""

_OF_BUCKETS = """
    SELECT sum(count)::bigint AS count, min(low) AS low, max(high) AS high,
        sum(mean * count) / sum(count) AS mean
    FROM telemetry_rollup
    WHERE device_id = cells.device_id AND status = cells.status AND level_s = {finer}
    AND at >= cells.at AND at < cells.at + {level}
"""

_COMPUTE = """
WITH taken AS (
    DELETE FROM telemetry_mark WHERE id IN (
        SELECT id FROM telemetry_mark WHERE level_s = {level} ORDER BY id LIMIT {marks}
    ) RETURNING device_ids, statuses, ats
), cells AS (
    SELECT DISTINCT device_id, status, floor(at / {level}) * {level} AS at
    FROM taken, unnest(device_ids, statuses, ats) AS told(device_id, status, at)
), kept AS (
    INSERT INTO telemetry_rollup AS old (device_id, status, level_s, at, low, high, mean, count)
    SELECT cells.device_id, cells.status, {level}, cells.at, low, high, mean, count
    FROM cells CROSS JOIN LATERAL ({source}) AS computed WHERE computed.count > 0
    ORDER BY 1, 2, 4
    ON CONFLICT (device_id, status, level_s, at) DO UPDATE SET
        low = excluded.low, high = excluded.high, mean = excluded.mean, count = excluded.count
    WHERE (old.low, old.high, old.mean, old.count)
        IS DISTINCT FROM (excluded.low, excluded.high, excluded.mean, excluded.count)
    RETURNING old.device_id, old.status, old.at
), onward AS (
    INSERT INTO telemetry_mark (level_s, due_at, device_ids, statuses, ats)
    SELECT {coarser}, %s, array_agg(device_id), array_agg(status), array_agg(at)
    FROM (
        SELECT DISTINCT device_id, status, floor(at / {coarser}) * {coarser} AS at FROM kept
    ) AS above WHERE {coarser} > {level} HAVING count(*) > 0
)
SELECT (SELECT count(*) FROM taken), (SELECT count(*) FROM kept)
"""

MOST_TRIMMED = 20_000
"""Rows of a level that are trimmed at once: some tenths of a second."""

_FADE = """
WITH RECURSIVE devices AS (
    SELECT id FROM enrollment_device
), known(device_id, status) AS (
    SELECT id, (SELECT min(status) FROM {table} WHERE device_id = devices.id) FROM devices
    UNION ALL
    SELECT known.device_id, (
        SELECT min(status) FROM {table}
        WHERE device_id = known.device_id AND status > known.status
    ) FROM known WHERE known.status IS NOT NULL
)
DELETE FROM {table} WHERE ctid = ANY (ARRAY(
    SELECT old.ctid FROM {table} AS old JOIN known USING (device_id, status)
    WHERE old.at < %s {and_level} LIMIT %s
))
"""


def roll_up(budget_s: float = 0.25) -> int:
    """Compute the buckets into which something came, finest level first.

    Each is computed whole from the level below, so that it does not matter how often, how late
    or in which order samples came. Only one process does it at a time.

    Args:
        budget_s: No further step begins after so long; what is left waits for the next call.

    Returns:
        How many buckets were written.
    """
    begun, written = time.monotonic(), 0
    for place, level in enumerate(LEVELS_S):
        while time.monotonic() - begun < budget_s and _is_due(level, time.time()):
            count = _step(place)
            if count is None:
                return written
            written += count
    return written


def _is_due(level: int, at: float) -> bool:
    with connection.cursor() as cursor:
        cursor.execute(
            "SELECT due_at FROM telemetry_mark WHERE level_s = %s ORDER BY id LIMIT 1", [level]
        )
        row = cursor.fetchone()
    return row is not None and row[0] <= at


def _step(place: int) -> int | None:
    """Compute what the oldest marks of a level name; None: another process is at it."""
    level = LEVELS_S[place]
    coarser = LEVELS_S[min(place + 1, len(LEVELS_S) - 1)]
    source = (
        _OF_SAMPLES if place == 0 else _OF_BUCKETS.format(finer=LEVELS_S[place - 1], level=level)
    )
    query = _COMPUTE.format(level=level, coarser=coarser, marks=_MARKS_AT_ONCE, source=source)
    with atomic(), connection.cursor() as cursor:
        cursor.execute("SELECT pg_try_advisory_xact_lock(%s)", [_ROLLING_LOCK])
        row = cursor.fetchone()
        if not (row and row[0]):
            return None
        cursor.execute(query, [time.time() + _WAIT_S[coarser]])
        found = cursor.fetchone()
    return 0 if found is None else int(found[1])


def trim(most: int = MOST_TRIMMED) -> int:
    """Forget what is older than the settings keep it, level by level.

    What has not been rolled up yet is not trimmed, should that be late.

    Args:
        most: Rows of each level that go at once; who trims does not keep others waiting.

    Returns:
        How many rows went; as many as `most` or more: there may be others.
    """
    at, count = time.time(), 0
    for level in (RAW, *LEVELS_S):
        if _is_overdue(level, at):
            continue
        before = at - settings.TELEMETRY_KEEP_S[level] - SLACK_S
        table = "telemetry_sample" if level == RAW else "telemetry_rollup"
        and_level = "" if level == RAW else f"AND old.level_s = {level}"
        with connection.cursor() as cursor:
            cursor.execute(_FADE.format(table=table, and_level=and_level), [before, most])
            count += cursor.rowcount
    longest_s = settings.TELEMETRY_KEEP_S[LEVELS_S[-1]]
    return count + Gap.objects.filter(until__lt=at - longest_s).delete()[0]


def _is_overdue(level: int, at: float) -> bool:
    """Tell whether buckets wait that are computed from a level, for longer than they should."""
    above = next((one for one in LEVELS_S if one > level), None)
    return above is not None and _is_due(above, at - OVERDUE_S)
