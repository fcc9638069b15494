"""REST of what happened to a resource, with the runs that did it."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

from rest_framework.request import Request

from labweb.accounts.selectors import user_of
from labweb.common.answers import NumberedRef
from labweb.crutd import api as crutd_api
from labweb.crutd.answers import EventList, EventRow, ResourceDetail
from labweb.domain.approvals.role_permissions import Permission
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors


class ResourceWithRuns(crutd_api.OneResource):
    """One resource."""

    def get(self, request: Request, resource_id: UUID) -> ResourceDetail:
        """Return a resource with what happened to it."""
        answer = super().get(request, resource_id)
        _name_runs(request, answer.events)
        return answer


class ResourceEventsWithRuns(crutd_api.ResourceEvents):
    """What happened to one resource."""

    def get(self, request: Request, resource_id: UUID) -> EventList:
        """List its events, newest first; the `events_next` of the resource goes on here."""
        answer = super().get(request, resource_id)
        _name_runs(request, answer.events)
        return answer


def _name_runs(request: Request, events: Iterable[EventRow]) -> None:
    """Name the run of each event, where the caller may see it; a few queries, or none."""
    known = _runs_of(request, {event.job_id for event in events if event.job_id is not None})
    for event in events:
        event.run = None if event.job_id is None else known.get(event.job_id)


def _runs_of(request: Request, job_ids: set[UUID]) -> dict[UUID, NumberedRef]:
    if not job_ids:
        return {}
    seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
    runs = selectors.visible_runs(resource_selectors.the_lab(), seen)
    jobs = selectors.with_runs(selectors.Job.objects.filter(pk__in=job_ids, run__in=runs))
    return {job.pk: NumberedRef(id=job.run_id, number=job.run.number) for job in jobs}
