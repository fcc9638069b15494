"""Writes of approval requests: opened, decided, expired, withdrawn."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from functools import partial
from typing import Any
from uuid import UUID

from django.db import connection
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.approvals import selectors
from labweb.approvals.models import ApprovalRequest, Decision
from labweb.common import feed
from labweb.common.clock import now
from labweb.domain.approvals import approval_policy as policy_rules
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import ForbiddenError, StateError
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab

_DECISION_LOCK = 0x6C61_6263


def open_request(  # noqa: PLR0913 - one column each
    *,
    lab: Lab,
    title: str,
    run_id: UUID | None = None,
    calibration_id: UUID | None = None,
    plan_digest: str,
    policies: Sequence[str],
    asked_by: User,
    expires_at: datetime,
) -> ApprovalRequest:
    """Ask a person about the plan, or about the result of a calibration, with this digest.

    A policy that is no row is a rule of the server's own: it asks somebody else.
    """
    rows = list(selectors.active_policies(lab).filter(name__in=list(policies)))
    is_own_rule = not set(policies) <= {row.name for row in rows}
    request = ApprovalRequest.objects.create(
        lab=lab,
        title=title,
        run_id=run_id,
        calibration_id=calibration_id,
        plan_digest=plan_digest,
        policies=list(policies),
        allow_self=all(row.allow_self for row in rows) and not is_own_rule,
        asked_by=asked_by,
        asked_at=now(),
        expires_at=expires_at,
    )
    on_commit(partial(feed.publish, "approvals", {"request_id": str(request.id)}))
    return request


def require_deciding(actor: User, lab: Lab) -> None:
    """Refuse who may not answer requests, whatever became of them.

    Raises:
        ForbiddenError: They may not, or only in a part of the lab.
    """
    resource_selectors.require(actor, Permission.DECIDE, [resource_selectors.root_of(lab).id])


@atomic
def decide(request_id: UUID, *, actor: User, is_approved: bool, comment: str) -> ApprovalRequest:
    """Write a person's answer; the first writer wins.

    Raises:
        NotFoundError: There is no such request.
        StateError: It was answered before, or has expired.
        ForbiddenError: The actor asked it themself, or may not decide here.
    """
    found = selectors.find_request(request_id)
    require_deciding(actor, found.lab)
    row = ApprovalRequest.objects.select_for_update(no_key=True).get(pk=request_id)
    state = row.state
    if state == ApprovalRequest.State.OPEN and row.expires_at < now():
        state = ApprovalRequest.State.EXPIRED
    code, message = policy_rules.check_decision(
        asked_by=str(row.asked_by_id),
        actor=str(actor.pk),
        allow_self=row.allow_self,
        state=str(state),
    )
    if code == "approval.own_request":
        raise ForbiddenError(message, code=code)
    if code:
        raise StateError(message, code=code)
    row.state = ApprovalRequest.State.APPROVED if is_approved else ApprovalRequest.State.REJECTED
    row.save(update_fields=["state"])
    _append_decision(
        request=row,
        actor=actor,
        printed_name=actor.printed_name,
        is_approved=is_approved,
        meaning=_meaning(row, is_approved=is_approved),
        comment=comment,
        plan_digest=row.plan_digest,
        at=now(),
    )
    account_services.write_audit(
        "approval.decide",
        str(row.id),
        actor=actor,
        reason=comment,
        detail={"approved": is_approved},
        meaning=_meaning(row, is_approved=is_approved),
    )
    on_commit(partial(feed.publish, "approvals", {"request_id": str(row.id)}))
    return row


def _append_decision(**fields: Any) -> None:  # noqa: ANN401 - the columns of a decision
    """Bind a decision to the one before, one at a time."""
    with connection.cursor() as cursor:
        cursor.execute("SELECT pg_advisory_xact_lock(%s)", [_DECISION_LOCK])
    seq, prev = selectors.end_of_decisions() or (0, "")
    decision = Decision(seq=seq + 1, prev_hash=prev, **fields)
    decision.hash = selectors.decision_hash(prev, decision)
    decision.save(force_insert=True)


def _meaning(row: ApprovalRequest, *, is_approved: bool) -> str:
    what = "the start" if row.run_id else "the driver" if row.driver_id else "the calibration"
    return f"{'approves' if is_approved else 'rejects'} {what}"


def expire_one() -> ApprovalRequest | None:
    """Close one request whose time is over, and return it; None: there is none.

    One about a driver stays as it is: nothing waits for it.

    A request that somebody answers at this moment is left to them.

    Effect:
        Nothing is released: the caller ends what waits for it in the same block.
    """
    due = ApprovalRequest.objects.filter(
        state=ApprovalRequest.State.OPEN, expires_at__lt=now(), driver_id__isnull=True
    )
    row = due.order_by("expires_at").select_for_update(skip_locked=True, no_key=True).first()
    if row is None:
        return None
    row.state = ApprovalRequest.State.EXPIRED
    row.save(update_fields=["state"])
    account_services.write_audit(
        "approval.expire",
        str(row.id),
        actor=None,
        reason="nobody answered in time",
        detail={
            "run" if row.run_id else "calibration": str(row.run_id or row.calibration_id),
            "expires_at": row.expires_at.isoformat(),
        },
    )
    on_commit(partial(feed.publish, "approvals", {"request_id": str(row.id)}))
    return row


def withdraw(run_id: UUID) -> None:
    """Close the open request of a run that was given up."""
    rows = ApprovalRequest.objects.filter(run_id=run_id, state=ApprovalRequest.State.OPEN)
    if rows.update(state=ApprovalRequest.State.WITHDRAWN):
        feed.publish("approvals", {"run_id": str(run_id)})
