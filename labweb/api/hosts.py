"""One edge host as its page shows it: session, journal, work, tickets, and who may do what."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from rest_framework.request import Request
from rest_framework.response import Response

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.api.devices import device_rows, host_rows
from labweb.common.render import iso
from labweb.crutd import selectors as crutd_selectors
from labweb.domain.approvals.roles import Permission
from labweb.domain.runs.session import MAY_BE_FENCED, SessionState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors as run_selectors
from labweb.runs.selectors import Custody, Job

_CLOSED = {SessionState.QUARANTINED.value, SessionState.FENCED.value}


class HostDetail(Endpoint):
    """One host."""

    def get(self, request: Request, host_id: UUID) -> Response:
        """Return a host whole; one that the caller may not see is not there."""
        user = user_of(request)
        lab = resource_selectors.the_lab()
        return Response(_render(enrollment_selectors.visible_host(lab, host_id, user), user))


def _render(row: EdgeHost, user: User) -> dict[str, Any]:
    seen = resource_selectors.allowed_ids(user, Permission.VIEW)
    devices = [
        device
        for device in enrollment_selectors.visible_present(row.lab, seen)
        if device.host_id == row.id
    ]
    fence = enrollment_selectors.open_fence(row)
    tickets = [
        ticket
        for ticket in crutd_selectors.visible_tickets(row.lab, seen)
        if str(ticket.detail.get("host_id", "")) == str(row.id)
    ]
    may = Permission.ADMIT in resource_selectors.permissions_on_all(user, row.lab)
    state = SessionState(row.state)
    return {
        **host_rows([row])[0],
        "floor": row.floor,
        "last_dseq": row.last_dseq,
        "epoch_seen": row.epoch_seen,
        "journal_id": None if row.journal_id is None else str(row.journal_id),
        "reason": _reason(row),
        "devices": device_rows(devices),
        "jobs": [_job(job) for job in run_selectors.work_at(row)],
        "tickets": [
            {
                "id": str(ticket.id),
                "code": ticket.code,
                "message": ticket.message,
                "opened_at": iso(ticket.opened_at),
            }
            for ticket in tickets
        ],
        "moves": [
            _move(move, row) for move in run_selectors.moves_of(row) if move.resource_id in seen
        ],
        "fence": None
        if fence is None
        else {
            "first_by": fence.first_by.printed_name,
            "first_at": iso(fence.first_at),
            "reason": fence.reason,
            "is_mine": fence.first_by_id == user.pk,
        },
        "can": {
            "fence": may
            and state in MAY_BE_FENCED
            and not (fence is not None and fence.first_by_id == user.pk),
            "readmit": may and row.state in _CLOSED,
            "revoke": may and state is not SessionState.REVOKED,
        },
    }


def _job(job: Job) -> dict[str, Any]:
    return {
        "id": str(job.id),
        "run_id": str(job.run_id),
        "run_number": job.run.number,
        "sentence": job.sentence,
        "state": job.state,
        "state_at": iso(job.state_at),
    }


def _move(move: Custody, row: EdgeHost) -> dict[str, Any]:
    return {
        "id": str(move.id),
        "name": move.resource.name,
        "place": None if move.place is None else move.place.name,
        "state": move.state,
        "is_leaving": move.owner_id == row.pk,
        "at": iso(move.at),
    }


def _reason(row: EdgeHost) -> dict[str, str] | None:
    """Return why a host is closed, where it is."""
    if row.state not in {*_CLOSED, SessionState.REVOKED.value}:
        return None
    return {
        "code": str(row.heartbeat.get("code", "host.quarantined")),
        "message": str(row.heartbeat.get("message", "")),
    }
