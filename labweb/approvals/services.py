"""Writes of policies, requests and decisions."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from functools import partial
from uuid import UUID

from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.approvals import selectors
from labweb.approvals.models import ApprovalRequest, Decision, Policy
from labweb.common import feed
from labweb.common.clock import now
from labweb.domain.approvals import policy as policy_rules
from labweb.domain.approvals.roles import Permission
from labweb.domain.errors import ForbiddenError, StateError
from labweb.domain.workflows.plan import Plan
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


def ensure_policy(lab: Lab, *, name: str, rule: dict[str, object]) -> Policy:
    """Write a policy unless one of that name exists."""
    policy_rules.parse_rule(rule)
    row, _ = Policy.objects.get_or_create(lab=lab, name=name, defaults={"rule": rule})
    return row


def asking_policies(lab: Lab, plan: Plan) -> list[Policy]:
    """Return the policies that want a person to look at the plan."""
    return [
        policy
        for policy in selectors.active_policies(lab)
        if policy_rules.asks(policy_rules.parse_rule(policy.rule), plan)
    ]


def open_request(  # noqa: PLR0913 - one column each
    *,
    lab: Lab,
    title: str,
    run_id: UUID,
    plan_digest: str,
    policies: Sequence[str],
    asked_by: User,
    expires_at: datetime,
) -> ApprovalRequest:
    """Ask a person about the plan with this digest."""
    rows = list(selectors.active_policies(lab).filter(name__in=list(policies)))
    request = ApprovalRequest.objects.create(
        lab=lab,
        title=title,
        run_id=run_id,
        plan_digest=plan_digest,
        policies=list(policies),
        allow_self=all(row.allow_self for row in rows),
        asked_by=asked_by,
        asked_at=now(),
        expires_at=expires_at,
    )
    on_commit(partial(feed.publish, "approvals", {"request_id": str(request.id)}))
    return request


@atomic
def decide(request_id: UUID, *, actor: User, is_approved: bool, comment: str) -> ApprovalRequest:
    """Write a person's answer; the first writer wins.

    Raises:
        NotFoundError: There is no such request.
        StateError: It was answered before, or has expired.
        ForbiddenError: The actor asked it themself, or may not decide here.
    """
    found = selectors.find_request(request_id)
    root = resource_selectors.root_of(found.lab)
    resource_selectors.require(actor, Permission.DECIDE, [root.id])
    row = ApprovalRequest.objects.select_for_update().get(pk=request_id)
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
    Decision.objects.create(
        request=row,
        actor=actor,
        printed_name=actor.printed_name,
        is_approved=is_approved,
        meaning="approves the start" if is_approved else "rejects the start",
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
    )
    on_commit(partial(feed.publish, "approvals", {"request_id": str(row.id)}))
    return row


def expire_one() -> ApprovalRequest | None:
    """Close one request whose time is over, and return it; None: there is none to close.

    A request that somebody answers at this moment is left to them.

    Effect:
        Nothing is released: the caller ends the run that waits for it in the same block.
    """
    due = ApprovalRequest.objects.filter(state=ApprovalRequest.State.OPEN, expires_at__lt=now())
    row = due.order_by("expires_at").select_for_update(skip_locked=True).first()
    if row is None:
        return None
    row.state = ApprovalRequest.State.EXPIRED
    row.save(update_fields=["state"])
    account_services.write_audit(
        "approval.expire",
        str(row.id),
        actor=None,
        reason="nobody answered in time",
        detail={"run": str(row.run_id), "expires_at": row.expires_at.isoformat()},
    )
    on_commit(partial(feed.publish, "approvals", {"request_id": str(row.id)}))
    return row


def withdraw(run_id: UUID) -> None:
    """Close the open request of a run that was given up."""
    rows = ApprovalRequest.objects.filter(run_id=run_id, state=ApprovalRequest.State.OPEN)
    if rows.update(state=ApprovalRequest.State.WITHDRAWN):
        feed.publish("approvals", {"run_id": str(run_id)})
