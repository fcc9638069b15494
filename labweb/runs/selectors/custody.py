"""Whose hands a vessel is in."""

from __future__ import annotations

from uuid import UUID

from django.db.models import Q, QuerySet

from labweb.domain.crutd.operations import TransferResource
from labweb.domain.runs.session import SessionState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab, Resource
from labweb.runs.models import Custody, Job, Outbox

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


def is_told(move: Custody) -> bool:
    """Say whether the new host of a vessel was told that it arrived, and has not answered."""
    if move.transfer_id is None:
        return False
    rows = Outbox.objects.filter(kind="receive", settled_at__isnull=True)
    return rows.filter(action_id=move.transfer_id).exists()


def carries_others(row: Resource) -> bool:
    """Say whether anything stands in a resource."""
    return resource_selectors.resources_of(row.lab).filter(parent_id=row.id).exists()


def hosts_between(row: Resource, operation: TransferResource) -> tuple[EdgeHost, EdgeHost] | None:
    """Return the host that has a vessel and the one of the place it goes to; None: not two."""
    owner, target = owner_of(row.lab, row.id), owner_of(row.lab, operation.to_id)
    if owner is None or target is None or owner.pk == target.pk:
        return None
    return None if {owner.state, target.state} & _GONE else (owner, target)
