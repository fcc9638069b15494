"""Which device does a job that asks for a role: the first that is free when its turn comes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from django.db.transaction import atomic, on_commit

from labweb.common.clock import now
from labweb.domain.errors import LockedError, PreconditionError
from labweb.domain.runs.dispatch.job_scheduler import DeviceCandidate, JobView, why_passed_by
from labweb.domain.runs.states.job_states import JobState
from labweb.domain.workflows.plan import CapableDevice
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device
from labweb.runs.models import Job
from labweb.runs.services.execution.dispatch import dispatch_on
from labweb.runs.services.execution.job_states import announce, hold_job
from labweb.runs.services.execution.run_holds import note_waiting
from labweb.telemetry import selectors as telemetry_selectors


def dispatch_by_role(run_id: UUID, view: JobView, online: Collection[UUID]) -> bool:
    """Send a job on the first of its devices that is free, and write down why it is that one.

    Free is what any job needs: its host online, nothing of it locked, reserved, in doubt or in the
    middle of another run's step, its calibration in force.

    Returns:
        False when it waits, which its `chosen` then explains. Where waiting frees none of them,
        the job is held, and a person decides.
    """
    choices = msgspec.convert(Job.objects.values_list("choices", flat=True).get(pk=view.id), _ALL)
    devices = enrollment_selectors.devices_by_id(one.device_id for one in choices)
    latest = telemetry_selectors.latest(devices)
    passed: list[str] = []
    waits: list[LockedError] = []
    refusals: list[PreconditionError] = []
    for choice in choices:
        device = devices[choice.device_id]
        why = why_passed_by(_candidate(device, choice, online, latest.get(device.id, {})))
        if not why:
            told = _told(device, passed, len(choices))
            try:
                return dispatch_on(run_id, view, device, **_fields(choice), chosen=told)
            except LockedError as error:
                why = error.message
                waits.append(error)
            except PreconditionError as error:
                why = error.message
                refusals.append(error)
        passed.append(f"{device.name}: {why}")
    _explain(run_id, view.id, f"waits for one that is free: {'; '.join(passed)}")
    if waits:
        note_waiting(run_id, waits[0])
    if len(refusals) == len(choices):
        hold_job(view.id, refusals[0])
    return False


_ALL = tuple[CapableDevice, ...]


def _candidate(
    device: Device,
    choice: CapableDevice,
    online: Collection[UUID],
    latest: Mapping[str, tuple[float, Any]],
) -> DeviceCandidate:
    newest = max((at for at, _ in latest.values()), default=None)
    return DeviceCandidate(
        state=device.state,
        host_name=device.host.name,
        is_host_online=device.host_id in online,
        is_on_planned_host=device.host_id == choice.host_id,
        silent_s=None if newest is None else now().timestamp() - newest,
    )


def _told(device: Device, passed: list[str], count: int) -> str:
    first = f"{device.name}, the first of {count} that was free"
    return f"{first}; {'; '.join(passed)}" if passed else first


def _fields(choice: CapableDevice) -> dict[str, Any]:
    """Return the columns of a job on that device."""
    plain = msgspec.to_builtins(choice)
    names = ("args", "operation", "pre", "post", "locks", "recovery", "corrections")
    return {name: plain[name] for name in names}


@atomic
def _explain(run_id: UUID, job_id: UUID, text: str) -> None:
    rows = Job.objects.filter(pk=job_id, state=JobState.QUEUED.value).exclude(chosen=text)
    if rows.update(chosen=text):
        on_commit(partial(announce, run_id, job_id))
