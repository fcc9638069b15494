"""What a device told and did while a thing was in it."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from labweb.common.render import iso
from labweb.crutd.selectors import provenance as crutd
from labweb.domain.crutd.provenance.build import reported
from labweb.domain.crutd.provenance.stays import clipped, stays_at
from labweb.enrollment.selectors import Device
from labweb.resources.selectors import Resource
from labweb.runs.models import Job
from labweb.runs.selectors import governed
from labweb.telemetry import selectors as telemetry_selectors

MOST_STAYS = 20
MOST_JOBS = 500


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
    told = [_stay(device, begin, end) for begin, end in parts[-MOST_STAYS:]]
    return {
        "resource": {"id": str(resource.id), "name": resource.name},
        "device": {"id": str(device.id), "name": device.name, "key": device.key},
        "stays": told,
        "is_truncated": len(parts) > MOST_STAYS or any(stay["has_more_acts"] for stay in told),
    }


def _stay(device: Device, begin: datetime, end: datetime) -> dict[str, Any]:
    rows = Job.objects.filter(device=device, started_at__lt=end).exclude(ended_at__lt=begin)
    jobs = list(rows.order_by("started_at")[: MOST_JOBS + 1])
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
                "driver_digest": job.driver_digest,
                "reported": reported(job),
            }
            for job in governed.job_facts(jobs[:MOST_JOBS])
        ],
        "has_more_acts": len(jobs) > MOST_JOBS,
    }
