"""Writes of policies, and which of them want a person to look at a plan."""

from __future__ import annotations

from collections.abc import Sequence

from labweb.approvals import selectors
from labweb.approvals.models import Policy
from labweb.domain.approvals import approval_policy as policy_rules
from labweb.domain.workflows.plan import Plan
from labweb.resources.selectors import Lab


def ensure_policy(lab: Lab, *, name: str, rule: dict[str, object]) -> Policy:
    """Write a policy unless one of that name exists."""
    policy_rules.parse_rule(rule)
    row, _ = Policy.objects.get_or_create(lab=lab, name=name, defaults={"rule": rule})
    return row


def asking_policies(lab: Lab, plan: Plan, rules: Sequence[Policy] | None = None) -> list[Policy]:
    """Return the policies that want a person to look at the plan; those in force, if read."""
    return [
        policy
        for policy in (selectors.RULES.rows(lab=lab.pk) if rules is None else rules)
        if policy_rules.asks(policy_rules.parse_rule(policy.rule), plan)
    ]
