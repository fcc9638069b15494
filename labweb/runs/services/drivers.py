"""Replace a device's driver while runs go on: nothing is cut off, and nothing is dropped."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from labweb.accounts.selectors import User
from labweb.crutd import services as crutd_services
from labweb.domain.enrollment.replacement import Waiting
from labweb.domain.errors import LockedError
from labweb.domain.messages import EdgeEvent
from labweb.domain.runs.job import AT_EDGE, FINAL
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import Device, EdgeHost
from labweb.runs.models import Job

KINDS = frozenset({"driver_ready", "driver_refused", "driver_serving"})


def replace_driver(device_id: UUID, version_id: UUID, *, actor: User, reason: str) -> Device:
    """Say which version of its driver a device shall have; an earlier one rolls back.

    Raises:
        LabError: As `labweb.enrollment.services.want_driver`.

    Effect:
        None on matter. The job that acts ends on the version before, and the next one begins
        on the new one, once the host has built it.
    """
    return enrollment_services.want_driver(
        device_id, version_id, actor=actor, reason=reason, waiting=waiting_at(device_id)
    )


def waiting_at(device_id: UUID) -> list[Waiting]:
    """Return what runs that go on will still ask of a device."""
    rows = Job.objects.filter(device_id=device_id, run__ended_at__isnull=True)
    rows = rows.exclude(state__in=[state.value for state in FINAL])
    return [
        Waiting(job=sentence, action=action, args=args)
        for sentence, action, args in rows.values_list("sentence", "action", "args")
    ]


def take_driver_event(host: EdgeHost, event: EdgeEvent) -> None:
    """Take in what a host says of a version that it was to make ready, or serves."""
    device_id, digest = UUID(str(event.body["device_id"])), str(event.body["digest"])
    if event.kind == "driver_ready":
        enrollment_services.note_ready(host, device_id, digest)
    elif event.kind == "driver_refused":
        device = enrollment_services.note_refused(host, device_id, event.body)
        if device is not None:
            crutd_services.open_ticket(
                host.lab,
                "driver.refused",
                f"{host.name} cannot build the driver that {device.name} was to have; the version "
                f"before stays: {event.body.get('message', '')}"[:2000],
                {"host_id": str(host.id), "device_id": str(device_id), "digest": digest},
            )


def switch_idle(host: EdgeHost) -> int:
    """Let versions that are ready take over on devices of a host that are idle.

    The caller has locked the host, as every dispatch does: nothing is sent meanwhile.

    Returns:
        How many devices changed.
    """
    count = 0
    for device in enrollment_selectors.staged_devices(host).filter(is_next_ready=True):
        if not is_acting(device):
            count += enrollment_services.switch_driver(device, waiting_at(device.id))
    return count


def switch_before(host: EdgeHost, jobs: Sequence[Job]) -> None:
    """Let devices change their drivers before they are sent anything more.

    Raises:
        LockedError: One of them acts still; the jobs wait for its end.
    """
    if not any(job.device.is_next_ready for job in jobs):
        return
    switch_idle(host)
    ids = {job.device_id for job in jobs}
    if enrollment_selectors.staged_devices(host).filter(pk__in=ids, is_next_ready=True).exists():
        raise LockedError("a device changes its driver first", code="driver.switching")


def is_acting(device: Device) -> bool:
    """Say whether a job of the device was sent and has not ended."""
    states = [state.value for state in AT_EDGE]
    return Job.objects.filter(device=device, state__in=states).exists()
