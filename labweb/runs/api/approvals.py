"""The endpoints of approval requests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar
from uuid import UUID

import msgspec
from django.db.models import Q
from msgspec.structs import asdict
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.approvals import selectors as approval_selectors
from labweb.approvals.selectors import ApprovalRequest
from labweb.calibration import selectors as calibration_selectors
from labweb.calibration.api import result_of
from labweb.calibration.services.calibrations import decide_calibration
from labweb.common.lists import HISTORY
from labweb.common.requests import Parameter, body, one_of, word
from labweb.crutd import selectors as crutd_selectors
from labweb.domain.errors import NotFoundError
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors, services
from labweb.runs.answers.approvals import (
    ApprovalDetail,
    ApprovalList,
    ApprovalRow,
    MaterialChange,
)
from labweb.runs.api import run_details
from labweb.runs.api.approval_rows import render_request
from labweb.runs.api.runs import visible, visible_runs
from labweb.runs.models import Run

_STATES = ("open", "all")


class Verdict(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a decision."""

    is_approved: bool
    comment: str = ""


class Requests(Endpoint):
    """Approval requests."""

    queries: ClassVar[Mapping[str, Parameter]] = {
        "state": one_of(_STATES, "Those that wait, or all."),
        **HISTORY.parameters,
    }

    def get(self, request: Request) -> ApprovalList:
        """List requests, open ones by default."""
        user = user_of(request)
        lab = resource_selectors.the_lab()
        shown = visible_runs(lab, user).values("pk")
        measured = calibration_selectors.measured_in(shown).values("pk")
        about = Q(run_id__in=shown) | Q(calibration_id__in=measured)
        rows = approval_selectors.requests_of(lab).filter(about)
        if word(request, "state", _STATES) == "open":
            rows = rows.filter(state="open")
        found, following = HISTORY.of_rows(request, rows, "-asked_at", "-id")
        behind = _runs_behind(found)
        runs = selectors.runs_by_id(list(behind.values()))
        allowed = resource_selectors.permissions_on_all(user, lab)
        return ApprovalList(
            requests=[render_request(row, runs[behind[row.pk]], user, allowed) for row in found],
            next=following,
        )


class OneRequest(Endpoint):
    """One approval request."""

    def get(self, request: Request, request_id: UUID) -> ApprovalDetail:
        """Return a request with the exact plan, or the result, that it is about."""
        user = user_of(request)
        row, run = _visible(request_id, user)
        told = asdict(render_request(row, run, user))
        if row.calibration_id is not None:
            result = result_of(calibration_selectors.find_calibration(row.calibration_id), user)
            return ApprovalDetail(**told, calibration=result)
        plan = run_details.render_plan(run, selectors.jobs_of(run))
        return ApprovalDetail(**told, plan=plan, materials=_materials(run))


def _materials(run: Run) -> list[MaterialChange]:
    states = crutd_selectors.lab_snapshot(list(resource_selectors.resources_of(run.lab)))
    before = {str(node): sum(state.contents.values()) for node, state in states.items()}
    after = dict(before)
    for job in run.plan["jobs"]:
        operation = job["operation"]
        if operation["op"] == "transfer_liquid":
            after[operation["source_id"]] -= operation["amount_nl"]
            after[operation["target_id"]] += operation["amount_nl"]
    return [
        MaterialChange(
            id=UUID(node),
            name=states[UUID(node)].name,
            before_nl=before[node],
            after_nl=after[node],
        )
        for node in before
        if before[node] != after[node]
    ]


class DecideRequest(Endpoint):
    """The answer to a request."""

    signs = frozenset({"post"})
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Verdict}

    def post(self, request: Request, request_id: UUID) -> ApprovalRow:
        """Approve or reject."""
        user = user_of(request)
        verdict = body(request, Verdict)
        row, run = _visible(request_id, user)
        is_approved, comment = verdict.is_approved, verdict.comment
        if row.calibration_id is None:
            services.decide_request(
                request_id, actor=user, is_approved=is_approved, comment=comment
            )
        else:
            decide_calibration(
                row.calibration_id, actor=user, is_accepted=is_approved, comment=comment
            )
        row, run = _visible(request_id, user)
        return render_request(row, run, user)


def _visible(request_id: UUID, user: User) -> tuple[ApprovalRequest, Run]:
    """Return a request with its run, of which the user may know.

    Raises:
        NotFoundError: There is none, or they may not see the run.
    """
    row = approval_selectors.find_request(request_id)
    try:
        return row, visible(_runs_behind([row])[row.pk], user)
    except NotFoundError as error:
        raise approval_selectors.no_request(request_id) from error


def _runs_behind(rows: Sequence[ApprovalRequest]) -> dict[UUID, UUID]:
    """Return the run of each request: the one that waits for it, or that measured."""
    about = [row.calibration_id for row in rows if row.calibration_id is not None]
    measured = calibration_selectors.runs_that_measured(about) if about else {}
    return {
        row.pk: approval_selectors.run_of(row)
        if row.calibration_id is None
        else measured[row.calibration_id]
        for row in rows
    }
