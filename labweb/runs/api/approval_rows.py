"""Render requests for approval as the browser reads them."""

from __future__ import annotations

from labweb.accounts.selectors import User
from labweb.approvals.selectors import ApprovalRequest
from labweb.common.answers import NumberedRef
from labweb.domain.approvals.approval_policy import check_decision
from labweb.domain.approvals.role_permissions import Permission
from labweb.resources import selectors as resource_selectors
from labweb.runs.answers.approvals import ApprovalAsker, ApprovalRow, DecisionMade, request_state
from labweb.runs.answers.run_rows import RunWorkflow
from labweb.runs.models import Run


def render_request(
    row: ApprovalRequest, run: Run, user: User, allowed: frozenset[Permission] | None = None
) -> ApprovalRow:
    """Render a request with whether this person may answer it.

    Args:
        row: The request.
        run: What it is about, or what measured it.
        user: Who asks to see it.
        allowed: What they may do to all of the lab; None looks it up.
    """
    if allowed is None:
        allowed = resource_selectors.permissions_on_all(user, row.lab)
    code, why_not = check_decision(
        asked_by=str(row.asked_by_id),
        actor=str(user.pk),
        allow_self=row.allow_self,
        state=row.state,
    )
    may = Permission.DECIDE in allowed
    if not may and not code:
        why_not = "deciding needs the role approver on the whole lab"
    return ApprovalRow(
        id=row.id,
        title=row.title,
        state=request_state(row.state),
        about="run" if row.calibration_id is None else "calibration",
        run=NumberedRef(id=run.id, number=run.number),
        workflow=RunWorkflow(
            id=run.version.workflow_id,
            name=run.version.workflow.name,
            version=run.version.number,
        ),
        policies=row.policies,
        asked_by=ApprovalAsker(name=row.asked_by.printed_name),
        asked_at=row.asked_at,
        expires_at=row.expires_at,
        plan_digest=row.plan_digest,
        can_decide=may and not code,
        why_not=why_not or None,
        decision=_decision(row),
    )


def _decision(row: ApprovalRequest) -> DecisionMade | None:
    decision = getattr(row, "decision", None)
    if decision is None:
        return None
    return DecisionMade(
        is_approved=decision.is_approved,
        printed_name=decision.printed_name,
        meaning=decision.meaning,
        comment=decision.comment,
        at=decision.at,
    )
