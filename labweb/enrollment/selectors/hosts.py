"""Reads of edge hosts and their sessions."""

from __future__ import annotations

from uuid import UUID

from django.db.models import QuerySet, UUIDField

from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.errors import NotFoundError
from labweb.domain.messages.stops import StopLabFrame
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.enrollment.models import (
    Device,
    EdgeHost,
    Fence,
)
from labweb.resources.selectors import Lab


def hosts_of(lab: Lab) -> QuerySet[EdgeHost]:
    """Edge hosts of a lab."""
    return EdgeHost.objects.filter(lab=lab).order_by("key")


def find_host(host_id: UUID) -> EdgeHost | None:
    """Return a host, or None."""
    return EdgeHost.objects.filter(pk=host_id).select_related("lab").first()


def open_stop(host_id: UUID) -> StopLabFrame | None:
    """Return the stop of its lab that a host has not acknowledged, or None."""
    host = find_host(host_id)
    if host is None or not host.lab.is_stopped or host.lab.stop_id is None:
        return None
    if host.stop_acknowledged == host.lab.stop_id:
        return None
    return StopLabFrame(stop_id=host.lab.stop_id, issued_by=str(host.lab.stopped_by_id))


def host_for_update(host_id: UUID) -> EdgeHost:
    """Lock and return a host.

    Raises:
        NotFoundError: There is none.
    """
    row = HOST_TO_LOCK.first(id=host_id)
    if row is None:
        raise NotFoundError(f"no host {host_id}", code="host.not_found")
    return row


HOST_TO_LOCK = Prepared(
    lambda: EdgeHost.objects.filter(pk=Given("id", UUIDField())).select_for_update(
        of=("self",), no_key=True
    )
)


def open_fence(host: EdgeHost) -> Fence | None:
    """Return the fence of a host that waits for its second signature, or None."""
    rows = Fence.objects.filter(host=host, second_at__isnull=True, withdrawn_at__isnull=True)
    return rows.select_related("first_by").first()


def all_hosts() -> QuerySet[EdgeHost]:
    """Every host of every lab."""
    return EdgeHost.objects.all()


def session_states() -> dict[UUID, SessionState]:
    """Return how the server sees every host; a suspended one is as good as away."""
    rows = EdgeHost.objects.values_list("id", "state", "suspended_at")
    return {
        host_id: SessionState(state) if suspended_at is None else _by_suspension(state)
        for host_id, state, suspended_at in rows
    }


def _by_suspension(state: str) -> SessionState:
    is_there = state in {SessionState.ONLINE.value, SessionState.SUSPECT.value}
    return SessionState.ISOLATED if is_there else SessionState(state)


def hosts_online() -> QuerySet[EdgeHost]:
    """The hosts that hear what is sent to them."""
    return EdgeHost.objects.filter(state="online")


def hosts_ready() -> QuerySet[EdgeHost]:
    """The hosts that may get new work."""
    return hosts_online().filter(suspended_at__isnull=True)


READY = Prepared(lambda: hosts_ready().values_list("pk", "name", "heartbeat"))
"""The hosts that may get new work: id, name, and what they said last."""


def hosts_switching() -> list[UUID]:
    """Return the hosts at which a version may take over that has not done so yet."""
    rows = Device.objects.filter(is_next_ready=True)
    return sorted(set(rows.values_list("host_id", flat=True)))
