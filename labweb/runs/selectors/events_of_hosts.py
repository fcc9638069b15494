"""What hosts have told, and the tries of jobs that they speak of."""

from __future__ import annotations

from django.db.models import QuerySet

from labweb.enrollment.selectors import EdgeHost
from labweb.runs.models import Attempt as Attempt
from labweb.runs.models import HostEvent as HostEvent


def events_of_host(host: EdgeHost) -> QuerySet[HostEvent]:
    """All that a host has told, journal by journal, each in its order."""
    return HostEvent.objects.filter(host=host).order_by("journal_id", "seq")


def countersigned_events(chain: str, signature: str) -> QuerySet[HostEvent]:
    """What hosts told of one signed head that they countersigned, oldest first."""
    rows = HostEvent.objects.filter(
        kind="countersigned", body__chain=chain, body__signature=signature
    )
    return rows.order_by("id")
