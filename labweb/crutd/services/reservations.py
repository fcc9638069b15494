"""Reserve resources for a person or an agent, for a while."""

from __future__ import annotations

from collections.abc import Collection
from datetime import timedelta
from uuid import UUID

from django.db.transaction import atomic

from labweb.common.clock import now
from labweb.crutd.models import ResourceReservation
from labweb.crutd.services.locks import hold
from labweb.domain.errors import DefinitionError, Finding, PreconditionError
from labweb.domain.runs.exclusive_use.reservations import check_request


@atomic
def reserve(
    ids: Collection[UUID], *, holder_id: UUID, lasts: timedelta, reason: str
) -> list[ResourceReservation]:
    """Reserve resources, with all below them, for one holder: all of them, or none.

    Nobody else begins anything on them until the time is over; what is under way goes on. Where
    somebody else has reserved one before, this one comes after it. A holder who has some of them
    already keeps the place in the line, for the new time.

    Raises:
        DefinitionError: The request itself is wrong; findings list each reason.
        LockedError: Somebody uses one this very moment: ask again.
        PreconditionError: One is in the Archive.

    Effect:
        None on matter.
    """
    findings = check_request(count=len(set(ids)), lasts=lasts, reason=reason)
    if findings:
        raise DefinitionError(findings[0].message, code=findings[0].code, findings=findings)
    rows, above = hold(ids)
    archived = [row for row in rows.values() if row.is_archived or row.id in above[1]]
    if archived:
        found = [
            Finding("crutd.archived", f"{row.name} is in the Archive", str(row.id))
            for row in archived
        ]
        raise PreconditionError(found[0].message, code="crutd.archived", findings=found)
    at = now()
    own = ResourceReservation.objects.filter(resource_id__in=rows, holder_id=holder_id)
    own = own.filter(ended_at=None, expires_at__gt=at)
    kept = dict(own.values_list("resource_id", "made_at"))
    own.update(ended_at=at, ended_by=holder_id)
    return ResourceReservation.objects.bulk_create(
        ResourceReservation(
            resource=row,
            holder_id=holder_id,
            reason=reason.strip(),
            made_at=kept.get(row.id, at),
            expires_at=at + lasts,
        )
        for row in rows.values()
    )


@atomic
def end_reservation(reservation_id: UUID, *, actor_id: UUID) -> None:
    """End a reservation before its time; one that is over stays as it is."""
    rows = ResourceReservation.objects.filter(pk=reservation_id, ended_at=None)
    rows.filter(expires_at__gt=now()).update(ended_at=now(), ended_by=actor_id)
