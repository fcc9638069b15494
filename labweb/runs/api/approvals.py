"""The endpoints of approval requests."""

from __future__ import annotations

from typing import Any, ClassVar
from uuid import UUID

import msgspec
from rest_framework.request import Request
from rest_framework.response import Response
from rest_framework.views import APIView

from labweb.accounts.selectors import user_of
from labweb.approvals import selectors as approval_selectors
from labweb.common.requests import body
from labweb.crutd import selectors as crutd_selectors
from labweb.domain.errors import DefinitionError
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors, services
from labweb.runs.api import render
from labweb.runs.api.runs import visible, visible_runs
from labweb.runs.models import Run


class Verdict(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a decision."""

    is_approved: bool
    comment: str = ""


class Requests(APIView):
    """Approval requests."""

    def get(self, request: Request) -> Response:
        """List requests, open ones by default."""
        user = user_of(request)
        lab = resource_selectors.the_lab()
        shown = visible_runs(lab, user).values("pk")
        rows = approval_selectors.requests_of(lab).filter(run_id__in=shown)
        state = request.query_params.get("state", "open")
        if state not in {"open", "all"}:
            raise DefinitionError("state is open or all", code="http.query")
        if state == "open":
            rows = rows.filter(state="open")
        found = list(rows[:200])
        runs = selectors.runs_by_id([approval_selectors.run_of(row) for row in found])
        allowed = resource_selectors.permissions_of(user)
        return Response(
            {
                "requests": [
                    render.render_request(row, runs[approval_selectors.run_of(row)], user, allowed)
                    for row in found
                ]
            }
        )


class RequestDetail(APIView):
    """One approval request."""

    def get(self, request: Request, request_id: UUID) -> Response:
        """Return a request with the exact plan it is about."""
        user = user_of(request)
        row = approval_selectors.find_request(request_id)
        run = visible(approval_selectors.run_of(row), user)
        jobs = list(selectors.jobs_of(run))
        return Response(
            {
                **render.render_request(row, run, user),
                "plan": render.render_plan(run, jobs),
                "materials": _materials(run),
            }
        )


def _materials(run: Run) -> list[dict[str, Any]]:
    states = crutd_selectors.lab_snapshot(list(resource_selectors.resources_of(run.lab)))
    before = {str(node): sum(state.contents.values()) for node, state in states.items()}
    after = dict(before)
    for job in run.plan["jobs"]:
        operation = job["operation"]
        if operation["op"] == "transfer_liquid":
            after[operation["source_id"]] -= operation["amount_nl"]
            after[operation["target_id"]] += operation["amount_nl"]
    return [
        {
            "id": node,
            "name": states[UUID(node)].name,
            "before_nl": before[node],
            "after_nl": after[node],
        }
        for node in before
        if before[node] != after[node]
    ]


class DecideRequest(APIView):
    """The answer to a request."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Verdict}

    def post(self, request: Request, request_id: UUID) -> Response:
        """Approve or reject."""
        user = user_of(request)
        verdict = body(request, Verdict)
        services.decide_request(
            request_id, actor=user, is_approved=verdict.is_approved, comment=verdict.comment
        )
        row = approval_selectors.find_request(request_id)
        run = selectors.find_run(approval_selectors.run_of(row))
        return Response(render.render_request(row, run, user))
