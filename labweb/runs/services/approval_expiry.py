"""End what waits for an approval that nobody gave in time: runs, and results of calibrations."""

from __future__ import annotations

from functools import partial

from django.db.transaction import atomic, on_commit, set_rollback

from labweb.accounts import services as account_services
from labweb.approvals import services as approval_services
from labweb.approvals.selectors import run_of
from labweb.calibration.services.calibrations import reject_unanswered
from labweb.common.clock import now
from labweb.domain.runs.states.job_states import JobState, Mover, RunState
from labweb.runs.models import Job, Run
from labweb.runs.services.execution.job_states import announce, move_job

_MOST_AT_ONCE = 100
_REASON = "nobody answered the request for approval in time"


def expire_requests() -> int:
    """Close every request whose time is over, and end what waits for it.

    Returns:
        How many were closed; the next call takes what is left.

    Effect:
        Nothing had begun: each such run ends ABORTED, with its jobs STOPPED. A result that nobody
        accepted is rejected.
    """
    for count in range(_MOST_AT_ONCE):
        if not _expire_one():
            return count
    return _MOST_AT_ONCE


@atomic
def _expire_one() -> bool:
    request = approval_services.expire_one()
    if request is None:
        return False
    if request.calibration_id is not None:
        if reject_unanswered(request.calibration_id, reason=_REASON):
            return True
        # Somebody answers at this moment: they go first.
        set_rollback(True)
        return False
    run = (
        Run.objects.filter(pk=run_of(request))
        .select_for_update(skip_locked=True, no_key=True)
        .first()
    )
    if run is None:
        # Somebody acts on the run and may wait for the request: they go first.
        set_rollback(True)
        return False
    if run.state != RunState.AWAITING_APPROVAL.value:
        return True
    for job in Job.objects.filter(run=run, state=JobState.AWAITING_APPROVAL.value):
        move_job(job, JobState.STOPPED, Mover.SERVER, code="approval.expired", message=_REASON)
    run.state = RunState.ABORTED.value
    run.ended_at = now()
    run.pause_reasons = []
    run.save(update_fields=["state", "ended_at", "pause_reasons"])
    account_services.write_audit("run.abort", str(run.id), actor=None, reason=_REASON)
    on_commit(partial(announce, run.id))
    return True
