"""What a device told and did while a thing was in it."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from labweb.common.render import iso
from labweb.crutd.selectors import provenance as crutd
from labweb.domain.crutd.provenance.graph_from_record import reported
from labweb.domain.crutd.provenance.stays_at_places import clipped, stays_at
from labweb.enrollment.selectors import Device
from labweb.records.selectors import activity_facts
from labweb.records.selectors.measurement_facts import Moment, moments
from labweb.resources.selectors import Resource
from labweb.runs.selectors import Job
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry.selectors import File

MOST_STAYS = 20
MOST_JOBS = 500
MOST_FILES = 500


def conditions(
    resource: Resource, device: Device, *, since: datetime, until: datetime
) -> dict[str, Any]:
    """Return each stay of a resource in a device within a window, with samples and acts.

    A resource is in a device while it stands, however deep, in one of the nodes that the
    device acts through. The newest stays are told when there are too many.
    """
    places = [str(node) for node in device.nodes.values()]
    stays = stays_at(str(resource.id), places, crutd.moves_of, crutd.parents_of)
    parts = clipped(stays, since, until)
    measured = _files(device, parts[0][0]) if parts else {}
    told = [_stay(device, begin, end, measured) for begin, end in parts[-MOST_STAYS:]]
    return {
        "resource": {"id": str(resource.id), "name": resource.name},
        "device": {"id": str(device.id), "name": device.name, "key": device.key},
        "stays": told,
        "is_truncated": len(parts) > MOST_STAYS
        or len(measured) > MOST_FILES
        or any(stay["has_more_acts"] for stay in told),
    }


def made_s(resource: Resource) -> float:
    """Return when a resource came to be, in seconds since the Unix epoch; 0: nobody knows."""
    at = crutd.made_at(resource.lab_id, resource.id)
    return 0.0 if at is None else at.timestamp()


def _files(device: Device, since: datetime) -> dict[File, Moment]:
    """Return files that came from the device since a moment, each with when it was measured."""
    rows = telemetry_selectors.files_of_device(device.id, since)[: MOST_FILES + 1]
    when = moments(device.lab, rows)
    return {row: when[row.pk] for row in rows}


def _stay(
    device: Device, begin: datetime, end: datetime, measured: Mapping[File, Moment]
) -> dict[str, Any]:
    rows = Job.objects.filter(device=device, started_at__lt=end).exclude(ended_at__lt=begin)
    jobs = list(rows.order_by("started_at")[: MOST_JOBS + 1])
    uncertain = {str(job.pk): job.uncertainty_s for job in jobs}
    return {
        "since": iso(begin),
        "until": iso(end),
        "series": telemetry_selectors.series(device.id, begin.timestamp(), end.timestamp()),
        "acts": [
            {
                "job_id": job.id,
                "run_id": job.run_id,
                "sentence": job.sentence,
                "state": job.state,
                "started_at": job.started_at,
                "ended_at": job.ended_at or None,
                "uncertainty_s": uncertain.get(job.id),
                "driver_digest": job.driver_digest,
                "reported": reported(job),
                "contexts": dict(job.contexts),
            }
            for job in activity_facts.job_facts(jobs[:MOST_JOBS])
        ],
        "files": [
            {
                "file_id": str(file.pk),
                "name": file.name,
                "sha256": file.sha256,
                "job_id": None if file.job_id is None else str(file.job_id),
                "resource_id": None if file.resource_id is None else str(file.resource_id),
                "at": iso(moment.at),
                "moment_by": moment.clue.value,
            }
            for file, moment in measured.items()
            if begin <= moment.at <= end
        ],
        "has_more_acts": len(jobs) > MOST_JOBS,
    }
