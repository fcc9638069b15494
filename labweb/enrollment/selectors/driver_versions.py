"""Reads of versions of drivers."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

from django.db.models import QuerySet, UUIDField

from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.errors import NotFoundError
from labweb.enrollment.models import DriverVersion


def drivers() -> QuerySet[DriverVersion]:
    """Every version of every driver, by module, the newest first."""
    rows = DriverVersion.objects.select_related("proposed_by", "approved_by")
    return rows.order_by("module", "-read_at")


def find_driver(version_id: UUID) -> DriverVersion:
    """Return a driver version with who proposed and approved it.

    Raises:
        NotFoundError: There is none.
    """
    row = _VERSION.first(id=version_id)
    if row is None:
        raise NotFoundError(f"no driver version {version_id}", code="driver.not_found")
    return row


_VERSION = Prepared(lambda: drivers().filter(pk=Given("id", UUIDField())))


def driver_for_update(version_id: UUID) -> DriverVersion:
    """Lock and return a driver version.

    Raises:
        NotFoundError: There is none.
    """
    row = _VERSION_TO_LOCK.first(id=version_id)
    if row is None:
        raise NotFoundError(f"no driver version {version_id}", code="driver.not_found")
    return row


_VERSION_TO_LOCK = Prepared(
    lambda: DriverVersion.objects.filter(pk=Given("id", UUIDField())).select_for_update(no_key=True)
)


def driver_names(digests: Iterable[str]) -> dict[str, str]:
    """Return the class of each driver version by the digest of its source."""
    rows = DriverVersion.objects.filter(digest__in=list(digests))
    return {row.digest: f"{row.module}:{row.class_name}" for row in rows}


def approved_drivers() -> QuerySet[DriverVersion]:
    """Driver versions that a device may be given, by class, the newest first."""
    rows = DriverVersion.objects.filter(state=DriverVersion.State.APPROVED)
    return rows.order_by("class_name", "-read_at")
