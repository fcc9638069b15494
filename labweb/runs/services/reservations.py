"""Reserve resources, but nothing that a live run of somebody else still needs."""

from __future__ import annotations

from collections.abc import Collection
from datetime import timedelta
from functools import partial
from uuid import UUID

from django.db.transaction import atomic, on_commit

from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.crutd import services as crutd_services
from labweb.crutd.selectors.reservations import ResourceReservation
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import Finding, ForbiddenError, LockedError
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors


@atomic
def reserve(
    ids: Collection[UUID], *, actor: User, lasts: timedelta, reason: str
) -> list[ResourceReservation]:
    """Reserve resources for the actor, all of them or none.

    Raises:
        ForbiddenError: The actor may not run things on one of them.
        DefinitionError, PreconditionError: As `crutd.services.reserve`.
        LockedError: A run of somebody else still needs one.

    Effect:
        None on matter. Nobody else begins anything on them before the time is over.
    """
    resource_selectors.require(actor, Permission.RUN, ids)
    made = crutd_services.reserve(ids, holder_id=actor.pk, lasts=lasts, reason=reason)
    rows = resource_selectors.names(ids)
    findings = [
        Finding(
            "reservation.run_under_way",
            f"run {run.number} of {run.created_by.printed_name} still needs {rows[node]}: "
            "reserve it when that run has ended",
            str(node),
            {"run_id": str(run.pk), "run": run.number},
        )
        for node, run in selectors.runs_that_need(ids, besides=actor)
    ]
    if findings:
        first = findings[0]
        raise LockedError(first.message, code=first.code, findings=findings)
    on_commit(_announce)
    return made


def end_reservation(row: ResourceReservation, *, actor: User) -> None:
    """End a reservation before its time.

    Raises:
        ForbiddenError: It is somebody else's, and the actor does not decide requests there.
    """
    if not may_end(row, actor):
        raise ForbiddenError(
            f"{row.holder.printed_name} reserved it: only they and approvers may end that",
            code="reservation.not_yours",
        )
    with atomic():
        crutd_services.end_reservation(row.pk, actor_id=actor.pk)
        on_commit(_announce)


def may_end(row: ResourceReservation, actor: User) -> bool:
    """Say whether somebody may end a reservation: its holder, and approvers there."""
    if row.holder_id == actor.pk:
        return True
    return row.resource_id in resource_selectors.allowed_ids(actor, Permission.DECIDE)


_announce = partial(feed.publish, "events", {})
