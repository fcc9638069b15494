"""Reads of events and their subjects."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

from django.db.models import QuerySet

from labweb.crutd.models import Event, EventSubject
from labweb.resources.selectors import Lab


def events_of(
    lab: Lab, *, resource_id: UUID | None = None, job_ids: Iterable[UUID] | None = None
) -> QuerySet[Event]:
    """Return events, newest first, with their transactions."""
    rows = Event.objects.filter(lab=lab).select_related("transaction")
    if resource_id is not None:
        rows = rows.filter(subjects__resource_id=resource_id).distinct()
    if job_ids is not None:
        rows = rows.filter(transaction__job_id__in=list(job_ids))
    return rows.order_by("-seq")


def subjects_of(event_ids: Iterable[int]) -> dict[int, list[EventSubject]]:
    """Return the resources of each event."""
    found: dict[int, list[EventSubject]] = {}
    rows = EventSubject.objects.filter(event_id__in=list(event_ids)).select_related("resource")
    for row in rows:
        found.setdefault(row.event_id, []).append(row)
    return found
