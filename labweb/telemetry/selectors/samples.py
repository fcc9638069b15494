"""Reads of samples as they came."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any
from uuid import UUID

from django.db import connection
from django.db.models import QuerySet

from labweb.common.database.prepared_queries import Question
from labweb.telemetry.models import Sample

_LATEST_IN = """
SELECT asked.id, told.value FROM enrollment_device AS asked CROSS JOIN LATERAL (
    SELECT value FROM telemetry_sample WHERE device_id = asked.id AND status = %s
    ORDER BY at DESC LIMIT 1
) AS told WHERE asked.lab_id = %s
"""

_LATEST = """
WITH RECURSIVE known(device_id, status) AS (
    SELECT asked.id, (SELECT min(status) FROM telemetry_sample WHERE device_id = asked.id)
    FROM unnest(%s::uuid[]) AS asked(id)
    UNION ALL
    SELECT known.device_id, (
        SELECT min(status) FROM telemetry_sample
        WHERE device_id = known.device_id AND status > known.status
    ) FROM known WHERE known.status IS NOT NULL
)
SELECT known.device_id, known.status, told.at, told.value FROM known CROSS JOIN LATERAL (
    SELECT at, value FROM telemetry_sample
    WHERE device_id = known.device_id AND status = known.status ORDER BY at DESC LIMIT 1
) AS told WHERE known.status IS NOT NULL
"""


def latest(device_ids: Iterable[UUID]) -> dict[UUID, dict[str, tuple[float, Any]]]:
    """Return the newest (seconds, value) of each status of each device.

    By the index, two steps for each status; what was told before is not read.
    """
    found: dict[UUID, dict[str, tuple[float, Any]]] = {}
    with connection.cursor() as cursor:
        cursor.execute(_LATEST, [list(device_ids)])
        for device_id, status, at, value in cursor.fetchall():
            found.setdefault(device_id, {})[status] = (at, json.loads(value))
    return found


def asking_latest_in(lab_id: UUID, status: str) -> Question[tuple[UUID, Any]]:
    """Return what finds the newest value of one status of each device of a lab that has told it.

    By the index, a step for each device; a day's samples are not read.
    """
    return Question(_LATEST_IN, [status, lab_id], _told)


def _told(row: Sequence[Any]) -> tuple[UUID, Any]:
    return row[0], json.loads(row[1])


def samples(device_ids: Iterable[UUID], since: float, until: float) -> QuerySet[Sample]:
    """Samples of some devices within the window, oldest first."""
    return Sample.objects.filter(
        device_id__in=list(device_ids), at__gte=since, at__lte=until
    ).order_by("at", "device_id", "status")


def newest_samples(
    device_id: UUID, status: str, since: float, until: float | None = None, most: int = 50
) -> list[tuple[float, Any]]:
    """Return (seconds, value) of one status from a moment on, the newest first."""
    rows = Sample.objects.filter(device_id=device_id, status=status, at__gt=since)
    if until is not None:
        rows = rows.filter(at__lt=until)
    return list(rows.order_by("-at").values_list("at", "value")[:most])


def last_samples(
    device_ids: Iterable[UUID], since: float, until: float
) -> list[tuple[UUID, str, float, Any]]:
    """Return (device, status, seconds, value): the last of each status within the window."""
    rows = (
        Sample.objects.filter(device_id__in=list(device_ids), at__gte=since, at__lte=until)
        .order_by("device_id", "status", "-at")
        .distinct("device_id", "status")
    )
    return list(rows.values_list("device_id", "status", "at", "value"))
