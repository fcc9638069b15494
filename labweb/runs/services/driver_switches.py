"""Let another version of a driver take over on a device that is idle, before it is sent more."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any
from uuid import UUID

from django.db import DatabaseError, OperationalError
from django.db.transaction import atomic

from labweb.crutd import services as crutd_services
from labweb.domain.enrollment.driver_replacement import PlannedJobAhead
from labweb.domain.errors import Finding, LabError, LockedError
from labweb.domain.runs.states.job_states import AT_EDGE, FINAL
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import Device, DriverVersion, EdgeHost
from labweb.runs.models import Job

logger = logging.getLogger(__name__)


def check_parts(device: Device, version: DriverVersion) -> list[Finding]:
    """List what speaks against the parts: matter, tubes, and jobs that will still use them."""
    findings, gone = crutd_services.check_parts(device, version)
    rows = Job.objects.filter(run__lab=device.lab, run__ended_at__isnull=True)
    rows = rows.exclude(state__in=[state.value for state in FINAL])
    needed = [row for row in rows.only("sentence", "locks") if gone & set(map(UUID, row.locks))]
    return [*findings, *(Finding("driver.still_needed", _uses(row)) for row in needed)]


def _uses(job: Job) -> str:
    return f"{job.sentence}: it uses a part that goes with this version"


def refit(device: Device, version: DriverVersion) -> Sequence[Finding]:
    """Give a device the parts of a version, as a person decided; or list why not.

    Raises:
        LockedError: A part is in use just now.
    """
    decided = device.next_parts
    if needed := check_parts(device, version):
        locked = [one for one in needed if one.code in PASSING]
        if len(locked) == len(needed):
            raise LockedError(locked[0].message, code=locked[0].code, findings=locked)
        return needed
    note = f"{version} for {device.name}: {decided['reason']}"
    try:
        crutd_services.refit_device(device, version, actor_id=UUID(decided["actor_id"]), note=note)
    except LockedError:
        raise
    except LabError as error:
        return error.findings or [Finding(error.code, error.message)]
    except OperationalError:
        raise
    except DatabaseError as error:
        logger.exception("the parts of %s cannot be written", version)
        text = f"the database refuses the parts of this version: {error}"
        return [Finding("driver.not_written", text, device.key)]
    return []


PASSING = frozenset({"crutd.held_elsewhere"})
"""What is over by itself: another operation uses the part this moment."""


def waiting_at(device_id: UUID) -> list[PlannedJobAhead]:
    """Return what runs that go on will still ask of a device."""
    rows = Job.objects.filter(device_id=device_id, run__ended_at__isnull=True)
    rows = rows.exclude(state__in=[state.value for state in FINAL])
    return [
        PlannedJobAhead(job=sentence, action=action, args=args)
        for sentence, action, args in rows.values_list("sentence", "action", "args")
    ]


def give_up(host: EdgeHost, device_id: UUID, problem: dict[str, Any], why: str) -> None:
    """Leave the version before in its place, and ask a person to look."""
    device = enrollment_services.note_refused(host, device_id, problem)
    if device is not None:
        text = (
            f"{device.name} does not get the driver that it was to have, and keeps its own: {why}"
        )
        detail = {"host_id": str(host.id), "device_id": str(device_id)}
        crutd_services.open_ticket(
            host.lab, "driver.refused", text[:2000], {**detail, "digest": problem["digest"]}
        )


def switch_idle(host: EdgeHost) -> int:
    """Let versions that are ready take over on devices of a host that are idle.

    The caller has locked the host, as every dispatch does: nothing is sent meanwhile.

    Returns:
        How many devices changed.
    """
    count = 0
    rows = enrollment_selectors.switching_devices(host).order_by("pk")
    # Locked: who takes a version back holds the device alone.
    for device in rows.select_for_update(of=("self",), no_key=True):
        if not is_acting(device):
            count += _switch(device)
    return count


def _switch(device: Device) -> bool:
    """Let the next version take over; False: a part of the device is in use, ask again.

    What is wrong with it is no fault of its host, and holds up no other device.
    """
    digest = "" if device.next_driver is None else device.next_driver.digest
    try:
        with atomic():
            return enrollment_services.switch_driver(device, waiting_at(device.id), refit)
    except LockedError:
        return False
    except OperationalError:
        raise
    except DatabaseError:
        logger.exception("%s does not change its driver", device.key)
        return False
    except (LabError, ValueError, KeyError, TypeError, AttributeError) as error:
        logger.exception("%s keeps its driver", device.key)
        text = f"what is kept of it makes no sense: {error}"
        problem = _problem(digest, code="driver.not_switched", message=text)
        give_up(device.host, device.pk, problem, text)
        return True


def _problem(digest: str, *, code: str, message: str) -> dict[str, Any]:
    return {"digest": digest, "code": code, "message": message}


def switch_before(host: EdgeHost, jobs: Sequence[Job]) -> None:
    """Let devices change their drivers before they are sent anything more.

    The jobs are given their devices anew, as they are after the change.

    Raises:
        LockedError: One of them acts still; the jobs wait for its end.
    """
    if not any(job.device.is_next_ready for job in jobs):
        return
    switch_idle(host)
    ids = {job.device_id for job in jobs}
    if enrollment_selectors.switching_devices(host).filter(pk__in=ids).exists():
        raise LockedError("a device changes its driver first", code="driver.switching")
    for job in jobs:
        job.device = enrollment_selectors.find_device(job.device_id)


def is_acting(device: Device) -> bool:
    """Say whether a job of the device was sent and has not ended."""
    states = [state.value for state in AT_EDGE]
    return Job.objects.filter(device=device, state__in=states).exists()
