"""Replace a device's driver while runs go on: nothing is cut off, and nothing is dropped."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from django.db import DatabaseError, OperationalError
from django.db.transaction import atomic

from labweb.accounts.selectors import User
from labweb.crutd import services as crutd_services
from labweb.domain.enrollment.driver_replacement import PlannedJobAhead
from labweb.domain.errors import (
    DefinitionError,
    Finding,
    LabError,
    LockedError,
    NotFoundError,
    PreconditionError,
    StateError,
)
from labweb.domain.messages.events import EdgeEvent
from labweb.domain.runs.states.job_states import AT_EDGE, FINAL
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import Device, DriverVersion, EdgeHost
from labweb.runs.models import Job
from labweb.runs.services.host_tickets import doubt

logger = logging.getLogger(__name__)

KINDS = frozenset({"driver_ready", "driver_refused", "driver_serving"})


@dataclass(frozen=True, slots=True)
class PartsOfVersion:
    """What another version changes of a device's parts, and what speaks against it now."""

    decision: str
    changes: Sequence[Finding]
    findings: Sequence[Finding]


def look_at_parts(device_id: UUID, version_id: UUID) -> PartsOfVersion:
    """Return which parts come, go and change when a device gets a version; nothing is written.

    Raises:
        NotFoundError: There is no such device or version.
    """
    device = enrollment_selectors.find_device(device_id)
    version = enrollment_selectors.find_driver(version_id)
    decision, changes = enrollment_services.parts_of_version(device, version)
    return PartsOfVersion(decision, changes, _against_parts(device, version) if changes else [])


def _against_parts(device: Device, version: DriverVersion) -> list[Finding]:
    """List what speaks against the parts: matter, tubes, and jobs that will still use them."""
    findings, gone = crutd_services.check_parts(device, version)
    rows = Job.objects.filter(run__lab=device.lab, run__ended_at__isnull=True)
    rows = rows.exclude(state__in=[state.value for state in FINAL])
    needed = [row for row in rows.only("sentence", "locks") if gone & set(map(UUID, row.locks))]
    return [*findings, *(Finding("driver.still_needed", _uses(row)) for row in needed)]


def _uses(job: Job) -> str:
    return f"{job.sentence}: it uses a part that goes with this version"


@atomic
def replace_driver(
    device_id: UUID, version_id: UUID, *, actor: User, reason: str, parts: str = ""
) -> Device:
    """Say which version of its driver a device shall have; an earlier one rolls back.

    Args:
        device_id: Which.
        version_id: Which version.
        actor: Who says so.
        reason: Why.
        parts: The decision of `look_at_parts`, where parts come or go with it.

    Raises:
        LabError: As `labweb.enrollment.services.want_driver`.

    Effect:
        None on matter. The job that acts ends on the version before, and the next one begins
        on the new one, once the host has built it.
    """
    # Locked, as for every switch: nothing is sent to the device, or ingested of it, meanwhile.
    host = enrollment_selectors.host_for_update(_host_of(device_id))
    seen = look_at_parts(device_id, version_id)
    device = enrollment_services.want_driver(
        device_id,
        version_id,
        actor=actor,
        reason=reason,
        waiting=waiting_at(device_id),
        decided=enrollment_services.Decided(
            parts, [one for one in seen.findings if one.code not in _PASSING]
        ),
    )
    if device.host_id != host.id:
        text = f"{device.name} went to another host just now: ask again"
        raise LockedError(text, code="driver.switching")
    if device.is_next_ready and not is_acting(device):
        enrollment_services.switch_driver(device, waiting_at(device_id), _refit)
    return device


@dataclass(frozen=True, slots=True)
class Given:
    """A device that is to have a version."""

    device_id: UUID
    parts: str = ""
    """The decision of `look_at_parts`, where parts come or go with it."""


@atomic
def replace_drivers(
    version_id: UUID, given: Sequence[Given], *, actor: User, reason: str
) -> list[Device]:
    """Say that devices shall have a version of their driver: all of them, or none.

    Args:
        version_id: Which version.
        given: The devices, each once.
        actor: Who says so.
        reason: Why.

    Raises:
        PreconditionError: It cannot serve some of them; `findings` list all that speaks against
            it, each with its device.
        LabError: As `replace_driver`.

    Effect:
        None on matter; nothing at all where one of them is refused.
    """
    if len({one.device_id for one in given}) != len(given):
        raise DefinitionError("a device is named twice", code="driver.named_twice")
    known = enrollment_selectors.devices_by_id(one.device_id for one in given)
    for host_id in sorted({device.host_id for device in known.values()}):
        enrollment_selectors.host_for_update(host_id)
    findings: list[Finding] = []
    devices: list[Device] = []
    for one in sorted(given, key=lambda one: one.device_id):
        try:
            devices.append(
                replace_driver(
                    one.device_id, version_id, actor=actor, reason=reason, parts=one.parts
                )
            )
        except (NotFoundError, LockedError):
            raise
        except (PreconditionError, StateError) as error:
            name = known[one.device_id].name
            found = error.findings or [Finding(error.code, error.message)]
            findings += [Finding(each.code, f"{name}: {each.message}", name) for each in found]
    if findings:
        text = "; ".join(finding.message for finding in findings)
        raise PreconditionError(text, code="driver.does_not_fit", findings=findings)
    return devices


def _host_of(device_id: UUID) -> UUID:
    return enrollment_selectors.find_device(device_id).host_id


def _refit(device: Device, version: DriverVersion) -> Sequence[Finding]:
    """Give a device the parts of a version, as a person decided; or list why not.

    Raises:
        LockedError: A part is in use just now.
    """
    decided = device.next_parts
    if needed := _against_parts(device, version):
        locked = [one for one in needed if one.code in _PASSING]
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


_PASSING = frozenset({"crutd.held_elsewhere"})
"""What is over by itself: another operation uses the part this moment."""


def waiting_at(device_id: UUID) -> list[PlannedJobAhead]:
    """Return what runs that go on will still ask of a device."""
    rows = Job.objects.filter(device_id=device_id, run__ended_at__isnull=True)
    rows = rows.exclude(state__in=[state.value for state in FINAL])
    return [
        PlannedJobAhead(job=sentence, action=action, args=args)
        for sentence, action, args in rows.values_list("sentence", "action", "args")
    ]


def take_driver_event(host: EdgeHost, event: EdgeEvent) -> None:
    """Take in what a host says of a version that it was to make ready, or serves."""
    device_id, digest = UUID(str(event.body["device_id"])), str(event.body["digest"])
    if event.kind == "driver_ready":
        enrollment_services.note_ready(host, device_id, digest)
    elif event.kind == "driver_refused":
        why = f"{host.name} cannot build it: {event.body.get('message', '')}"
        _give_up(host, device_id, event.body, why)
        _doubt_unserved(host, device_id, event.body)
    else:
        enrollment_services.note_served(host, device_id, digest)


def _doubt_unserved(host: EdgeHost, device_id: UUID, body: dict[str, Any]) -> None:
    """Ask a person to look at a device whose own version its host cannot load."""
    device = enrollment_services.note_unserved(host, device_id, body)
    if device is not None:
        text = (
            f"{device.name} is not served, and nothing starts on it: {host.name} cannot load its "
            f"driver: {body.get('message', '')}. Put the approved source back on {host.name} and "
            "start it again, or have the changed one approved as another version"
        )
        detail = {"device_id": str(device_id), "digest": body["digest"]}
        doubt(host, "driver.not_served", text[:2000], detail, "device_id")


def _give_up(host: EdgeHost, device_id: UUID, problem: dict[str, Any], why: str) -> None:
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
            return enrollment_services.switch_driver(device, waiting_at(device.id), _refit)
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
        _give_up(device.host, device.pk, problem, text)
        return True


def _problem(digest: str, *, code: str, message: str) -> dict[str, Any]:
    return {"digest": digest, "code": code, "message": message}


def switch_waiting() -> int:
    """Let versions take over that are ready and waited for a part of their device to be free.

    Returns:
        How many devices changed.
    """
    count = 0
    for host_id in enrollment_selectors.hosts_switching():
        with atomic():
            count += switch_idle(enrollment_selectors.host_for_update(host_id))
    return count


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
