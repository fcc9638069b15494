"""Reads of samples."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from uuid import UUID

from django.db.models import QuerySet

from labweb.telemetry.models import Sample

MOST_POINTS = 4000


def series(device_id: UUID, since: float, until: float) -> dict[str, list[tuple[float, Any]]]:
    """Return (seconds, value) by status within the window, oldest first, at most 4000 each."""
    found: dict[str, list[tuple[float, Any]]] = {}
    rows = Sample.objects.filter(device_id=device_id, at__gte=since, at__lte=until).order_by("at")
    for status, at, value in rows.values_list("status", "at", "value"):
        found.setdefault(status, []).append((at, value))
    return {
        status: points[:: max(1, len(points) // MOST_POINTS + (len(points) > MOST_POINTS))]
        for status, points in found.items()
    }


def latest(device_ids: Iterable[UUID]) -> dict[UUID, dict[str, tuple[float, Any]]]:
    """Return the newest (seconds, value) of each status of each device."""
    rows = (
        Sample.objects.filter(device_id__in=list(device_ids))
        .order_by("device_id", "status", "-at")
        .distinct("device_id", "status")
    )
    found: dict[UUID, dict[str, tuple[float, Any]]] = {}
    for device_id, status, at, value in rows.values_list("device_id", "status", "at", "value"):
        found.setdefault(device_id, {})[status] = (at, value)
    return found


def samples(device_ids: Iterable[UUID], since: float, until: float) -> QuerySet[Sample]:
    """Samples of some devices within the window, oldest first."""
    return Sample.objects.filter(
        device_id__in=list(device_ids), at__gte=since, at__lte=until
    ).order_by("at", "id")
