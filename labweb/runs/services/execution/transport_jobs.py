"""A job that carries a thing between hosts: in the hands of its own host while it acts.

    QUEUED ─ handed to its host ─▶ DISPATCHED … COMPLETE ─ handed to the host of the place ─▶

No hand-over moves anything: the thing stands where it is, and another host writes its facts.
"""

from __future__ import annotations

from uuid import UUID

from django.db.transaction import atomic

from labweb.common.database.prepared_queries import together
from labweb.crutd import services as crutd_services
from labweb.domain.crutd import operations
from labweb.domain.crutd.operations import TransferResource
from labweb.domain.crutd.settlement import Change
from labweb.domain.errors import LockedError, PreconditionError
from labweb.domain.runs.dispatch.job_scheduler import JobView
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors
from labweb.runs.models import Attempt
from labweb.runs.services.execution import custody, dispatch, run_holds
from labweb.runs.services.execution.job_states import hold_job


def dispatch_carry(run_id: UUID, view: JobView) -> bool:
    """Dispatch a job that carries something, as soon as its host has that in its hands.

    Returns:
        False when it has to wait: for a lock, or for the host that has the thing, which is
        asked to let it go. A precondition that fails now holds the job, as does a host that
        keeps the thing.
    """
    try:
        with atomic():
            if _is_handed_over(run_id, view):
                return False
            return dispatch.dispatch_job(run_id, view)
    except LockedError as error:
        run_holds.note_waiting(run_id, error)
        return False
    except PreconditionError as error:
        hold_job(view.id, error)
        return False


def _is_handed_over(run_id: UUID, view: JobView) -> bool:
    """Begin to hand a thing to the host that carries it; False: it has it, or nobody has."""
    held = dispatch.hold_for_dispatch(run_id, view)
    if held is None:
        return False
    host, job = held.host, held.job
    operation = operations.from_json(job.operation)
    if not isinstance(operation, TransferResource):
        return False
    row = resource_selectors.find_resource(operation.resource_id)
    hosts = selectors.hands_between(selectors.owner_of(row.lab, row.id), host)
    if hosts is None:
        return False
    granted = run_holds.ask(held.run, [job])
    in_place = _in_place(operation.resource_id, operation.from_id)
    found = crutd_services.hold_to_open(
        in_place,
        row.lab,
        [row.id],
        asker=crutd_services.Asker(actor_id=job.run.created_by_id, run_id=job.run_id),
        job_id=job.id,
        granted=granted.modes,
    )
    together(found.opening, *granted.writing)
    custody.begin(row, hosts, found.row, actor=job.run.created_by, job=job)
    return True


def hand_on(attempt: Attempt, change: Change) -> None:
    """Hand what a job has carried to the host of its new place, in the block that settled it.

    What went into quarantine stays with the host that has to tell what happened.
    """
    operation = operations.from_json(attempt.transaction.operation)
    if not isinstance(operation, TransferResource):
        return
    thing = operation.resource_id
    if change.moves.get(thing) != operation.to_id or thing in change.quarantined:
        return
    row = resource_selectors.find_resource(thing)
    hosts = selectors.hands_between(attempt.host, selectors.owner_of(row.lab, operation.to_id))
    if hosts is None:
        return
    in_place = _in_place(thing, operation.to_id)
    transaction = crutd_services.lock_next(attempt.transaction, in_place)
    run = attempt.job.run
    custody.begin(row, hosts, transaction, actor=run.created_by, job=attempt.job)


def _in_place(resource_id: UUID, place_id: UUID) -> TransferResource:
    return TransferResource(resource_id=resource_id, from_id=place_id, to_id=place_id)
