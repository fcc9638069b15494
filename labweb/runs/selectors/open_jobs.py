"""Jobs that act, wait or are in doubt."""

from __future__ import annotations

from collections.abc import Collection
from uuid import UUID

from django.db.models import Q, QuerySet

from labweb.domain.runs.states.job_states import AT_EDGE, FINAL, JobState
from labweb.resources.selectors import Lab
from labweb.runs.models import Job
from labweb.runs.selectors.jobs_without_plans import with_runs


def open_jobs(lab: Lab) -> QuerySet[Job]:
    """Jobs of a lab that act, wait in a run that goes on, or are in doubt; run by run."""
    rows = Job.objects.filter(run__lab=lab).exclude(state__in=[state.value for state in FINAL])
    sent = [state.value for state in (*AT_EDGE, JobState.IN_DOUBT)]
    rows = rows.filter(Q(run__ended_at__isnull=True) | Q(state__in=sent))
    return with_runs(rows).order_by("run__number", "index")


def jobs_to_move(ids: Collection[UUID]) -> QuerySet[Job]:
    """Lock and return some jobs of a run, in the order of its plan."""
    return Job.objects.filter(pk__in=ids).order_by("index").select_for_update(no_key=True)
