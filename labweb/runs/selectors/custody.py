"""Whose hands a vessel is in."""

from __future__ import annotations

from uuid import UUID

from django.db.models import Q, QuerySet

from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs.models import Custody, Job


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
