"""Whose hands a vessel is in."""

from __future__ import annotations

from collections.abc import Collection
from uuid import UUID

from django.db.models import Q, QuerySet

from labweb.domain.crutd.operations import TransferResource
from labweb.domain.errors import NotFoundError
from labweb.domain.runs.exclusive_use.resource_custody import next_hands
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab, Resource
from labweb.runs.models import Custody, Job, Outbox, Run

_GONE = {SessionState.FENCED.value, SessionState.REVOKED.value}
"""Hosts that will never answer again: the record is the server's."""


def owner_of(lab: Lab, resource_id: UUID) -> EdgeHost | None:
    """Return the host that writes the facts of a resource; None: no host does.

    It is the host that received it last, else the host that worked on it last, else the
    host of the nearest device it stands in.
    """
    moved = Custody.objects.filter(resource_id=resource_id, ended_at__isnull=False)
    last = moved.select_related("owner").order_by("-ended_at").first()
    if last is not None and last.owner is not None:
        return last.owner
    rows = Job.objects.filter(run__lab=lab, locks__contains=[str(resource_id)])
    job = rows.filter(attempts__isnull=False).select_related("device__host").order_by("-state_at")
    used = job.first()
    if used is not None:
        return used.device.host
    above = {resource_id, *resource_selectors.ancestors([resource_id])[resource_id]}
    for device in enrollment_selectors.enrolled_devices(lab):
        if above & {UUID(node) for node in device.nodes.values()}:
            return device.host
    return None


def moves_of(host: EdgeHost) -> QuerySet[Custody]:
    """Vessels on their way from or to a host."""
    rows = Custody.objects.filter(ended_at__isnull=True).filter(Q(owner=host) | Q(target=host))
    return rows.select_related("resource", "place", "target", "owner")


def open_move_of(resource_id: UUID) -> Custody | None:
    """Return the move that a vessel is on."""
    rows = Custody.objects.select_related("origin", "target", "place", "asked_by")
    return rows.filter(resource_id=resource_id, ended_at__isnull=True).first()


def find_move(custody_id: UUID, seen: Collection[UUID]) -> Custody:
    """Return a move of one of the resources.

    Raises:
        NotFoundError: There is none, or it is of another.
    """
    row = Custody.objects.filter(pk=custody_id).first()
    if row is None or row.resource_id not in seen:
        raise NotFoundError(f"no move {custody_id}", code="custody.not_found")
    return row


def is_told(move: Custody) -> bool:
    """Say whether the new host of a vessel was told that it arrived, and has not answered."""
    if move.transfer_id is None:
        return False
    rows = Outbox.objects.filter(kind="receive", settled_at__isnull=True)
    return rows.filter(action_id=move.transfer_id).exists()


def hosts_between(row: Resource, operation: TransferResource) -> tuple[EdgeHost, EdgeHost] | None:
    """Return the host that has a vessel and the one of the place it goes to; None: not two."""
    return hands_between(owner_of(row.lab, row.id), owner_of(row.lab, operation.to_id))


def hands_between(
    owner: EdgeHost | None, wanted: EdgeHost | None
) -> tuple[EdgeHost, EdgeHost] | None:
    """Return both hosts where the first has to hand a thing to the second; None: it need not."""
    if owner is None or wanted is None:
        return None
    gone = {host.pk for host in (owner, wanted) if host.state in _GONE}
    return None if next_hands(owner.pk, wanted.pk, gone=gone) is None else (owner, wanted)


def hosts_of_carry(lab: Lab, resource_id: UUID, place_id: UUID) -> frozenset[UUID]:
    """Return the hosts that a carry waits for: of the thing and of the place it goes to."""
    found = (owner_of(lab, resource_id), owner_of(lab, place_id))
    return frozenset(host.pk for host in found if host is not None and host.state not in _GONE)


def moves_of_run(run: Run) -> QuerySet[Custody]:
    """Hand-overs of what a run carries, oldest first."""
    rows = Custody.objects.filter(job__run=run).order_by("at")
    return rows.select_related("resource", "origin", "target", "job")
