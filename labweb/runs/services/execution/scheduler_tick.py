"""One turn of the scheduler: what may go now, alone or in batches."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from uuid import UUID

from labweb.common import disk
from labweb.domain.disk_space import DiskRoomLevel
from labweb.domain.runs.dispatch.job_scheduler import JobView, may_begin, pair_of, ready
from labweb.domain.runs.host_actions.host_batch import ALONE, find_batches
from labweb.domain.workflows.plan import Execution
from labweb.runs import selectors
from labweb.runs.services.execution.device_choice import dispatch_by_role
from labweb.runs.services.execution.dispatch import dispatch_job
from labweb.runs.services.execution.failure_containment import is_away, is_passing, set_aside
from labweb.runs.services.execution.host_batches import dispatch_batch
from labweb.runs.services.execution.transport_jobs import dispatch_carry

logger = logging.getLogger(__name__)


def dispatch_ready() -> int:
    """Dispatch every job that may go now, each alone or each batch in a transaction.

    A run that has not begun waits while the server's disk, or that of one of its hosts, has too
    little room; one that has begun goes on. A run that fails in a way that nobody foresaw is
    paused, and keeps no other from its turn. One that was in somebody's way has its next turn.

    Returns:
        How many jobs were dispatched.

    Raises:
        Exception: The database is away (`is_away`); or, after all others had their turn, what
            kept a run from being paused.
    """
    found = selectors.to_schedule()
    failed, count = dict(found.senseless), 0
    is_full = disk.level() is DiskRoomLevel.FULL
    for run_id, execution, views in found.runs:
        if not may_begin(views, found.short_of_room, is_server_full=is_full):
            continue
        try:
            count += _dispatch_run(run_id, execution, views, found.online)
        except Exception as error:
            if is_away(error):
                raise
            if is_passing(error):
                logger.warning("run %s has its next turn: %s", run_id, error)
            else:
                failed[run_id] = error
    _set_aside_all(failed)
    return count


def _set_aside_all(failed: Mapping[UUID, Exception]) -> None:
    left: Exception | None = None
    for run_id, cause in failed.items():
        try:
            set_aside(run_id, cause)
        except Exception as error:
            if is_away(error):
                raise
            left = error
    if left is not None:
        raise left


def _dispatch_run(
    run_id: UUID, execution: Execution | None, views: Sequence[JobView], online: Collection[UUID]
) -> int:
    count = 0
    waiting = ready(views, online)
    for view in waiting:
        if view.meets is not None:
            pair = pair_of(view, waiting) if execution is None else None
            if pair is not None:
                count += dispatch_batch(run_id, [one.id for one in pair], ALONE)
        elif view.choice_host_ids:
            count += dispatch_by_role(run_id, view, online)
        elif execution is None or view.is_carry:
            count += (dispatch_carry if view.is_carry else dispatch_job)(run_id, view)
    if execution is not None:
        for members in find_batches(views, online):
            count += dispatch_batch(run_id, [view.id for view in members], execution)
    return count
