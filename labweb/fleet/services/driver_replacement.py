"""Replace a device's driver while runs go on: nothing is cut off, and nothing is dropped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from django.db.transaction import atomic

from labweb.accounts.selectors import User
from labweb.domain.errors import (
    DefinitionError,
    Finding,
    LockedError,
    NotFoundError,
    PreconditionError,
    StateError,
)
from labweb.domain.messages.events import EdgeEvent
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import Device, EdgeHost
from labweb.runs.services import driver_switches
from labweb.runs.services.host_tickets import doubt

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
    return PartsOfVersion(
        decision, changes, driver_switches.check_parts(device, version) if changes else []
    )


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
        waiting=driver_switches.waiting_at(device_id),
        decided=enrollment_services.Decided(
            parts, [one for one in seen.findings if one.code not in driver_switches.PASSING]
        ),
    )
    if device.host_id != host.id:
        text = f"{device.name} went to another host just now: ask again"
        raise LockedError(text, code="driver.switching")
    if device.is_next_ready and not driver_switches.is_acting(device):
        enrollment_services.switch_driver(
            device, driver_switches.waiting_at(device_id), driver_switches.refit
        )
    return device


@dataclass(frozen=True, slots=True)
class GivenDriver:
    """A device that is to have a version."""

    device_id: UUID
    parts: str = ""
    """The decision of `look_at_parts`, where parts come or go with it."""


@atomic
def replace_drivers(
    version_id: UUID, given: Sequence[GivenDriver], *, actor: User, reason: str
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


def take_driver_event(host: EdgeHost, event: EdgeEvent) -> None:
    """Take in what a host says of a version that it was to make ready, or serves."""
    device_id, digest = UUID(str(event.body["device_id"])), str(event.body["digest"])
    if event.kind == "driver_ready":
        enrollment_services.note_ready(host, device_id, digest)
    elif event.kind == "driver_refused":
        why = f"{host.name} cannot build it: {event.body.get('message', '')}"
        driver_switches.give_up(host, device_id, event.body, why)
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


def switch_waiting() -> int:
    """Let versions take over that are ready and waited for a part of their device to be free.

    Returns:
        How many devices changed.
    """
    count = 0
    for host_id in enrollment_selectors.hosts_switching():
        with atomic():
            count += driver_switches.switch_idle(enrollment_selectors.host_for_update(host_id))
    return count
