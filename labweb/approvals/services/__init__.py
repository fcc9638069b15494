"""Writes of policies, requests and decisions."""

from __future__ import annotations

from labweb.approvals.services.approval_requests import (
    decide,
    expire_one,
    open_request,
    require_deciding,
    withdraw,
)
from labweb.approvals.services.driver_approval import (
    DRIVER_RULE,
    decide_driver,
    submit_driver,
    submit_read,
    withdraw_driver,
)
from labweb.approvals.services.driver_tryouts import (
    TryoutWanted,
    TryoutWish,
    ask_tryout,
    begin_tryout,
    frames_of,
    take_offer,
    take_told,
)
from labweb.approvals.services.policies import asking_policies, ensure_policy

__all__ = [
    "DRIVER_RULE",
    "TryoutWanted",
    "TryoutWish",
    "ask_tryout",
    "asking_policies",
    "begin_tryout",
    "decide",
    "decide_driver",
    "ensure_policy",
    "expire_one",
    "frames_of",
    "open_request",
    "require_deciding",
    "submit_driver",
    "submit_read",
    "take_offer",
    "take_told",
    "withdraw",
    "withdraw_driver",
]
