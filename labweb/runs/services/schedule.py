"""One turn of the scheduler: what may go now, alone or in batches."""

from __future__ import annotations

from labweb.domain.runs.batch import find_batches
from labweb.domain.runs.scheduler import ready
from labweb.enrollment import selectors as enrollment_selectors
from labweb.runs import selectors
from labweb.runs.services.batches import dispatch_batch
from labweb.runs.services.dispatch import dispatch_job


def dispatch_ready() -> int:
    """Dispatch every job that may go now, each alone or each batch in a transaction.

    Returns:
        How many jobs were dispatched.
    """
    online = set(enrollment_selectors.hosts_online().values_list("pk", flat=True))
    count = 0
    for run in selectors.runs_to_schedule():
        views = selectors.views(run.id)
        execution = selectors.execution_of(run)
        if execution is None:
            count += sum(dispatch_job(view.id) for view in ready(views, online))
            continue
        for members in find_batches(views, online):
            count += dispatch_batch(run, [view.id for view in members], execution)
    return count
