"""Declare a host lost, by two people, or take its key away for good."""

from __future__ import annotations

from functools import partial
from uuid import UUID

from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import now
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.enrollment.admission_reason import refuse_no_reason
from labweb.domain.errors import ForbiddenError, StateError
from labweb.domain.runs.host_link.host_session import (
    FENCED_CODE,
    SessionState,
    check_fence,
    fenced,
    quarantined,
)
from labweb.enrollment import selectors
from labweb.enrollment.models import EdgeHost, Fence
from labweb.enrollment.services.host_messages import tell_host
from labweb.enrollment.services.hosts import keep_record, record_of
from labweb.resources import selectors as resource_selectors


@atomic
def sign_fence(host_id: UUID, *, actor: User, reason: str) -> tuple[EdgeHost, bool]:
    """Sign that a host is lost; the second signature, by another person, fences it.

    Both say the same: the machine is off, or its devices are, and it can move nothing more.

    Returns:
        The host, and whether it is fenced from here on. The caller then puts what it was
        given in doubt, in the same block.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: The actor may not admit hosts, or signed first.
        DefinitionError: No reason was given.
        StateError: The host answers, or is fenced already.

    Effect:
        None on matter. Nothing that the host was given may start there any more, should it
        come back; it comes back into quarantine.
    """
    row = selectors.host_for_update(host_id)
    _check_actor(row, actor, reason)
    open_fence = selectors.open_fence(row)
    first_by = None if open_fence is None else str(open_fence.first_by_id)
    answer = check_fence(SessionState(row.state), first_by, str(actor.pk))
    if answer is not None:
        error = ForbiddenError if answer.code == "host.same_person" else StateError
        raise error(f"{row.name}: {answer.message}", code=answer.code)
    if record_of(row).quarantine == FENCED_CODE:
        raise StateError(f"{row.name} is fenced already", code="host.not_lost")
    account_services.write_audit(
        "host.fence",
        str(row.id),
        actor=actor,
        reason=reason,
        meaning="the machine is off, or its devices are: it can move nothing more",
    )
    on_commit(partial(feed.publish, "hosts", {"host_id": str(row.id)}))
    if open_fence is None:
        Fence.objects.create(host=row, reason=reason, first_by=actor, first_at=now())
        return row, False
    open_fence.second_by = actor
    open_fence.second_at = now()
    open_fence.reason = f"{open_fence.reason}\n{reason}"
    open_fence.save(update_fields=["second_by", "second_at", "reason"])
    keep_record(row, fenced(record_of(row)))
    row.state = SessionState.FENCED.value
    row.state_at = now()
    text = f"declared lost by {open_fence.first_by.printed_name} and {actor.printed_name}"
    row.heartbeat = {"code": FENCED_CODE, "message": text}
    row.save()
    on_commit(partial(tell_host, row.id, {"type": "edge.renew"}))
    return row, True


def withdraw_fences() -> int:
    """Withdraw first signatures under hosts that have been heard of since.

    Returns:
        How many were withdrawn.
    """
    heard = [SessionState.ONLINE.value, SessionState.SYNCING.value, SessionState.SUSPECT.value]
    rows = Fence.objects.filter(
        host__state__in=heard, second_at__isnull=True, withdrawn_at__isnull=True
    )
    return rows.update(withdrawn_at=now())


@atomic
def revoke_host(host_id: UUID, *, actor: User, reason: str) -> EdgeHost:
    """Take a host's keys away for good: it is never let in again.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: The actor may not admit hosts.
        DefinitionError: No reason was given.
        StateError: It was revoked before.

    Effect:
        None on matter. Its connection is closed and what it was given is void; the caller
        puts its jobs in doubt in the same block. Its devices serve nobody until they are
        given to another host.
    """
    row = selectors.host_for_update(host_id)
    _check_actor(row, actor, reason)
    if row.state == SessionState.REVOKED.value:
        raise StateError(f"{row.name} was revoked before", code="host.revoked")
    keep_record(row, quarantined(record_of(row), "host.revoked"))
    row.state = SessionState.REVOKED.value
    row.state_at = now()
    row.suspended_at = None
    row.heartbeat = {"code": "host.revoked", "message": f"revoked by {actor.printed_name}"}
    row.save()
    row.certificates.filter(ended_at__isnull=True).update(ended_at=now())
    account_services.write_audit(
        "host.revoke",
        str(row.id),
        actor=actor,
        reason=reason,
        meaning="takes the host's keys away for good",
    )
    on_commit(partial(tell_host, row.id, {"type": "edge.renew"}))
    on_commit(partial(feed.publish, "hosts", {"host_id": str(row.id)}))
    return row


def _check_actor(row: EdgeHost, actor: User, reason: str) -> None:
    root = resource_selectors.root_of(row.lab)
    resource_selectors.require(actor, Permission.ADMIT, [root.id])
    refuse_no_reason(reason, "say what you know", code="host.no_reason")
