"""REST of what happened to a resource, with the runs that did it."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from rest_framework.request import Request
from rest_framework.response import Response

from labweb.accounts.selectors import user_of
from labweb.crutd import api as crutd_api
from labweb.domain.approvals.roles import Permission
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors


class ResourceDetail(crutd_api.ResourceDetail):
    """One resource."""

    def get(self, request: Request, resource_id: UUID) -> Response:
        """Return a resource with what happened to it."""
        return _with_runs(request, super().get(request, resource_id))


class ResourceEvents(crutd_api.ResourceEvents):
    """What happened to one resource."""

    def get(self, request: Request, resource_id: UUID) -> Response:
        """List its events, newest first; the `events_next` of the resource goes on here."""
        return _with_runs(request, super().get(request, resource_id))


def _with_runs(request: Request, answer: Response) -> Response:
    """Name the run of each event, where the caller may see it; a few queries, or none."""
    events: list[dict[str, Any]] = answer.data["events"]
    known = _runs_of(request, {event["job_id"] for event in events} - {None})
    for event in events:
        event["run"] = known.get(event["job_id"])
    return answer


def _runs_of(request: Request, job_ids: set[str]) -> dict[str, dict[str, Any]]:
    if not job_ids:
        return {}
    seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
    runs = selectors.visible_runs(resource_selectors.the_lab(), seen)
    jobs = selectors.with_runs(selectors.Job.objects.filter(pk__in=job_ids, run__in=runs))
    return {str(job.pk): {"id": str(job.run_id), "number": job.run.number} for job in jobs}
