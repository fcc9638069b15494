"""Edge hosts as pages show them: session, journal, work, tickets, and who may do what."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

import msgspec
from msgspec.structs import asdict
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.common import disk
from labweb.common.lists import STANDING
from labweb.crutd import selectors as crutd_selectors
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.disk_space import DiskRoomLevel
from labweb.domain.runs.exclusive_use.resource_custody import CustodyState
from labweb.domain.runs.host_link.host_session import MAY_BE_FENCED, SessionState
from labweb.domain.runs.states.job_states import JobState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import EdgeHost
from labweb.fleet.answers.hosts import (
    DiskLevel,
    HostClosed,
    HostDetail,
    HostDisk,
    HostFence,
    HostJob,
    HostList,
    HostMove,
    HostRights,
    HostRow,
    HostTicket,
)
from labweb.fleet.api.devices import device_rows
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors as run_selectors
from labweb.runs.selectors import Custody, Job

_CLOSED = {SessionState.QUARANTINED.value, SessionState.FENCED.value}


class Hosts(Endpoint):
    """Edge hosts of the lab."""

    queries = STANDING.parameters

    def get(self, request: Request) -> HostList:
        """List the hosts of devices that the caller may see, with their journals' lag."""
        lab = resource_selectors.the_lab()
        rows = enrollment_selectors.visible_hosts(lab, user_of(request))
        found, following = STANDING.of_list(request, rows, lambda row: [row.key, row.pk.hex])
        return HostList(hosts=host_rows(found), next=following)


class OneHost(Endpoint):
    """One host."""

    def get(self, request: Request, host_id: UUID) -> HostDetail:
        """Return a host whole; one that the caller may not see is not there."""
        user = user_of(request)
        lab = resource_selectors.the_lab()
        return _whole(enrollment_selectors.visible_host(lab, host_id, user), user)


def _whole(row: EdgeHost, user: User) -> HostDetail:
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
    return HostDetail(
        **asdict(host_rows([row])[0]),
        floor=row.floor,
        last_dseq=row.last_dseq,
        epoch_seen=row.epoch_seen,
        journal_id=row.journal_id,
        reason=_reason(row),
        devices=device_rows(devices),
        jobs=[_job(job) for job in run_selectors.work_at(row)],
        tickets=[
            HostTicket(
                id=ticket.id,
                code=ticket.code,
                message=ticket.message,
                opened_at=ticket.opened_at,
            )
            for ticket in tickets
        ],
        moves=[
            _move(move, row) for move in run_selectors.moves_of(row) if move.resource_id in seen
        ],
        fence=None
        if fence is None
        else HostFence(
            first_by=fence.first_by.printed_name,
            first_at=fence.first_at,
            reason=fence.reason,
            is_mine=fence.first_by_id == user.pk,
        ),
        can=HostRights(
            fence=may
            and state in MAY_BE_FENCED
            and not (fence is not None and fence.first_by_id == user.pk),
            readmit=may and row.state in _CLOSED,
            revoke=may and state is not SessionState.REVOKED,
        ),
    )


def _job(job: Job) -> HostJob:
    return HostJob(
        id=job.id,
        run_id=job.run_id,
        run_number=job.run.number,
        sentence=job.sentence,
        state=JobState(job.state),
        state_at=job.state_at,
    )


def _move(move: Custody, row: EdgeHost) -> HostMove:
    return HostMove(
        id=move.id,
        name=move.resource.name,
        place=None if move.place is None else move.place.name,
        state=CustodyState(move.state),
        is_leaving=move.owner_id == row.pk,
        at=move.at,
    )


def _reason(row: EdgeHost) -> HostClosed | None:
    """Return why a host is closed, where it is."""
    if row.state not in {*_CLOSED, SessionState.REVOKED.value}:
        return None
    return HostClosed(
        code=str(row.heartbeat.get("code", "host.quarantined")),
        message=str(row.heartbeat.get("message", "")),
    )


def host_rows(hosts: Iterable[EdgeHost]) -> list[HostRow]:
    """Render hosts."""
    return [
        HostRow(
            id=row.id,
            key=row.key,
            name=row.name,
            state=SessionState(row.state),
            last_seen_at=row.last_seen_at,
            epoch=row.epoch,
            acked_seq=row.acked_seq,
            journal_lag=max(int(row.heartbeat.get("seq_head", 0)) - row.acked_seq, 0),
            devices_count=row.devices.count(),
            state_at=row.state_at,
            away_since_at=row.away_since_at,
            clock_skew_s=row.clock_skew_s,
            heartbeat=row.heartbeat,
            disk=_disk(row),
        )
        for row in hosts
    ]


def _disk(row: EdgeHost) -> HostDisk | None:
    """Render what a host said last of its disk, and what follows from it."""
    found = enrollment_selectors.disk_of(row.name, row.heartbeat)
    if found is None:
        return None
    floors = disk.floors()
    level = found.level(floors)
    told = "" if level is DiskRoomLevel.OK else f"{found.headline()}. {found.consequence(floors)}"
    return HostDisk(
        free_bytes=found.free_bytes, level=msgspec.convert(level.value, DiskLevel), text=told
    )
