"""Requests for approval."""

from __future__ import annotations

from datetime import datetime
from typing import Literal
from uuid import UUID

import msgspec
from msgspec import UNSET, UnsetType

from labweb.calibration.answers import CalibrationChange
from labweb.common.answers import ApiAnswer, NumberedRef
from labweb.runs.answers.plans import PlanView
from labweb.runs.answers.run_rows import RunWorkflow

RequestState = Literal["open", "approved", "rejected", "withdrawn", "expired"]
RequestAbout = Literal["run", "calibration"]


def request_state(word: str) -> RequestState:
    """Return a kept state as the word that it is."""
    found: RequestState = msgspec.convert(word, RequestState)
    return found


class ApprovalAsker(ApiAnswer):
    """Who asked for an approval."""

    name: str


class DecisionMade(ApiAnswer):
    """The answer of a person to a request."""

    is_approved: bool
    printed_name: str
    meaning: str
    comment: str
    at: datetime


class ApprovalRow(ApiAnswer):
    """A request with whether the caller may answer it."""

    id: UUID
    title: str
    state: RequestState
    about: RequestAbout
    run: NumberedRef
    """The run that waits for it, or that measured."""

    workflow: RunWorkflow
    policies: list[str]
    asked_by: ApprovalAsker
    asked_at: datetime
    expires_at: datetime
    plan_digest: str
    can_decide: bool
    why_not: str | None
    decision: DecisionMade | None


class ApprovalList(ApiAnswer):
    """A page of requests."""

    requests: list[ApprovalRow]
    next: str | None
    """What `after` takes for the next page; null: this is the last one."""


class MaterialChange(ApiAnswer):
    """A vessel whose content a plan changes, and by how much."""

    id: UUID
    name: str
    before_nl: int
    after_nl: int


class ApprovalDetail(ApprovalRow):
    """A request with the exact plan, or the result, that it is about."""

    calibration: CalibrationChange | UnsetType = UNSET
    """The result of a calibration; left out where it is about a run."""

    plan: PlanView | UnsetType = UNSET
    materials: list[MaterialChange] | UnsetType = UNSET
