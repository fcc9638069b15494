"""Jobs with their runs, without what is large of a run and would come once for each job."""

from __future__ import annotations

from django.db.models import QuerySet

from labweb.runs.models import Job


def with_runs(rows: QuerySet[Job], *more: str) -> QuerySet[Job]:
    """Follow jobs to their runs, and along the other names, but leave the plans behind.

    The plan of a run of hundreds of jobs has megabytes, and so has its workflow.
    """
    rows = rows.select_related("run", *more).defer("run__plan")
    if not any(name.startswith("run__version") for name in more):
        return rows
    return rows.defer("run__plan", "run__version__document", "run__version__proved")
