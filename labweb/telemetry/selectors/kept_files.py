"""Reads of files and readings."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from datetime import datetime
from pathlib import Path
from uuid import UUID

from django.conf import settings
from django.db.models import Max, Q, QuerySet

from labweb.domain.errors import NotFoundError
from labweb.enrollment import selectors as enrollment_selectors
from labweb.resources.selectors import Lab
from labweb.telemetry.models import File, Incoming, Reading


def visible_files(lab: Lab, seen: Collection[UUID]) -> QuerySet[File]:
    """Return files about one of the resources or, with none told, from a device that acts there."""
    return File.objects.filter(_is_about(lab, seen), lab=lab).select_related("kept_by")


def visible_readings(lab: Lab, seen: Collection[UUID]) -> QuerySet[Reading]:
    """Return readings of one of the resources or, with none told, of a device that acts there."""
    return Reading.objects.filter(_is_about(lab, seen), lab=lab).select_related(
        "file__lab", "series_file"
    )


def _is_about(lab: Lab, seen: Collection[UUID]) -> Q:
    devices = [row.pk for row in enrollment_selectors.visible_devices(lab, seen)]
    return Q(resource_id__in=list(seen)) | Q(resource__isnull=True, device_id__in=devices)


def find_file(lab: Lab, file_id: UUID, seen: Collection[UUID]) -> File:
    """Return a file that is about something of what may be seen.

    Raises:
        NotFoundError: There is none.
    """
    row = visible_files(lab, seen).filter(pk=file_id).first()
    if row is None:
        raise NotFoundError(f"no file {file_id}", code="file.not_found")
    return row


def visible_incoming(lab: Lab, seen: Collection[UUID]) -> QuerySet[Incoming]:
    """Return what was brought about something of what may be seen, newest first."""
    return Incoming.objects.filter(_is_about(lab, seen), lab=lab).select_related("brought_by")


def find_incoming(lab: Lab, incoming_id: UUID, seen: Collection[UUID]) -> Incoming:
    """Return a file that was brought about something of what may be seen.

    Raises:
        NotFoundError: There is none.
    """
    row = visible_incoming(lab, seen).filter(pk=incoming_id).first()
    if row is None:
        raise NotFoundError(f"no file {incoming_id}", code="file.not_found")
    return row


def named_by(action_ids: Iterable[UUID]) -> QuerySet[Incoming]:
    """Return the files that actions of hosts have named, and what became of each."""
    return Incoming.objects.filter(action_id__in=list(action_ids))


def awaited_files() -> QuerySet[Incoming]:
    """Return the files that actions have named and whose bytes have not come."""
    return Incoming.objects.filter(state=Incoming.State.AWAITED).order_by("id")


def measured_by(job_ids: Iterable[UUID]) -> QuerySet[Incoming]:
    """Return the files that jobs have measured, whether they have come or not, oldest first."""
    rows = Incoming.objects.filter(job_id__in=list(job_ids), action_id__isnull=False)
    return rows.order_by("id")


def has_file(sha256: str, *, device_id: UUID, job_id: UUID) -> bool:
    """Tell whether a file of a device and a job is kept."""
    return File.objects.filter(sha256=sha256, device_id=device_id, job_id=job_id).exists()


def readings_of_jobs(job_ids: Iterable[UUID]) -> QuerySet[Reading]:
    """Return the readings that belong to jobs, with their files."""
    rows = Reading.objects.filter(job_id__in=list(job_ids))
    return rows.select_related("file", "series_file").order_by("file_id", "index")


def series_about(job_ids: Iterable[UUID], vessels: Iterable[UUID]) -> QuerySet[Reading]:
    """Return the readings that are series and belong to jobs or to vessels, oldest first."""
    about = Q(job_id__in=list(job_ids)) | Q(resource_id__in=list(vessels))
    rows = Reading.objects.filter(about, series_file__isnull=False)
    return rows.select_related("file", "series_file").order_by("file_id", "index")


def files_of_jobs(job_ids: Iterable[UUID]) -> QuerySet[File]:
    """Return the files that belong to jobs, oldest first."""
    rows = File.objects.filter(job_id__in=list(job_ids)).order_by("id")
    return rows.select_related("resource", "made_from")


def files_of(lab: Lab) -> QuerySet[File]:
    """Return the files of a lab as they came."""
    return File.objects.filter(lab=lab, made_from__isnull=True).order_by("-id")


def readings_of(lab: Lab) -> QuerySet[Reading]:
    """Return the readings of a lab, with their files."""
    return Reading.objects.filter(lab=lab).select_related("file__lab").order_by("file_id", "index")


def files_about(
    lab: Lab, resources: Iterable[UUID], jobs: Iterable[UUID], ids: Iterable[UUID] = ()
) -> QuerySet[File]:
    """Return files as they came of the resources, the jobs or the ids, newest first."""
    subject = Q(resource_id__in=list(resources)) | Q(job_id__in=list(jobs)) | Q(pk__in=list(ids))
    return File.objects.filter(subject, lab=lab, made_from__isnull=True).order_by("-id")


def files_of_device(device_id: UUID, since: datetime) -> QuerySet[File]:
    """Return files as they came from a device, kept since a moment; newest first."""
    rows = File.objects.filter(device_id=device_id, made_from__isnull=True, kept_at__gte=since)
    return rows.order_by("-id")


def first_readings(file_ids: Iterable[UUID], most: int) -> QuerySet[Reading]:
    """Return the first readings of each file."""
    rows = Reading.objects.filter(file_id__in=list(file_ids), index__lte=most)
    return rows.order_by("file_id", "index")


def measured_at(file_ids: Iterable[UUID]) -> dict[UUID, datetime]:
    """Return the latest moment that each file tells of itself, where it tells one."""
    rows = Reading.objects.filter(file_id__in=list(file_ids), measured_at__isnull=False)
    found = rows.order_by("file_id").values_list("file_id").annotate(Max("measured_at"))
    return {file_id: at for file_id, at in found if at is not None}


def series_of(file_ids: Iterable[UUID]) -> QuerySet[File]:
    """Return the series that were made from files."""
    return File.objects.filter(made_from_id__in=list(file_ids)).order_by("id")


def find_reading(lab: Lab, reading_id: UUID, seen: Collection[UUID]) -> Reading:
    """Return a reading of something of what may be seen.

    Raises:
        NotFoundError: There is none.
    """
    row = visible_readings(lab, seen).filter(pk=reading_id).first()
    if row is None:
        raise NotFoundError(f"no reading {reading_id}", code="reading.not_found")
    return row


def path_of(sha256: str) -> Path:
    """Return where the bytes of a digest lie."""
    return Path(settings.DATA_DIR) / "files" / sha256[:2] / sha256
