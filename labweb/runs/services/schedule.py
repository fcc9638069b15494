"""One turn of the scheduler: what may go now, alone or in batches."""

from __future__ import annotations

from labweb.domain.runs.batch import find_batches
from labweb.domain.runs.scheduler import ready
from labweb.enrollment import selectors as enrollment_selectors
from labweb.runs import selectors
from labweb.runs.services.batches import dispatch_batch
from labweb.runs.services.carrying import dispatch_carry
from labweb.runs.services.dispatch import dispatch_job


def dispatch_ready() -> int:
    """Dispatch every job that may go now, each alone or each batch in a transaction.

    Returns:
        How many jobs were dispatched.
    """
    online = enrollment_selectors.ready_ids()
    count = 0
    for run_id, execution in selectors.runs_to_schedule():
        views = selectors.views(run_id)
        alone = [view for view in ready(views, online) if execution is None or view.is_carry]
        for view in alone:
            count += (dispatch_carry if view.is_carry else dispatch_job)(run_id, view)
        if execution is None:
            continue
        for members in find_batches(views, online):
            count += dispatch_batch(run_id, [view.id for view in members], execution)
    return count
