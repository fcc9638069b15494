"""Which device has which version of its driver, and how far a replacement has come."""

from __future__ import annotations

from collections.abc import Mapping
from uuid import UUID

import msgspec
from django.db.models import QuerySet

from labweb.accounts.selectors import User
from labweb.common.answers import KeyedRef
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import NotFoundError
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.enrollment import selectors
from labweb.enrollment.selectors import Device, DriverVersion
from labweb.fleet.answers.drivers import (
    DriverHost,
    DriverJob,
    DriverPlace,
    DriverProblem,
    DriverServing,
    DriverUse,
    NextDriver,
)
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors as run_selectors


def driver_of(device: Device) -> DriverUse:
    """Say which version a device has, which it is to have, and what went wrong last."""
    after = device.next_driver
    told, problem = device.serving, device.driver_problem
    return DriverUse(
        version_id=device.driver_id,
        digest=device.driver.digest,
        class_name=device.driver.class_name,
        next=None
        if after is None
        else NextDriver(version_id=after.id, digest=after.digest, is_ready=device.is_next_ready),
        problem=msgspec.convert(problem, DriverProblem) if problem else None,
        serving=None
        if not told
        else DriverServing(
            digest=told["digest"],
            at=told["at"],
            host_id=UUID(told["host_id"]),
            is_present=told["digest"] == device.driver.digest,
        ),
    )


def users_of(user: User) -> dict[UUID, list[KeyedRef]]:
    """Return the devices that the user may see, by the version that they have."""
    found: dict[UUID, list[KeyedRef]] = {}
    for device in _visible(user):
        entry = KeyedRef(id=device.id, key=device.key, name=device.name)
        found.setdefault(device.driver_id, []).append(entry)
    return found


def _reads_all(user: User) -> bool:
    """Say whether a person may see every driver: who sees the whole lab, or chooses drivers."""
    if Permission.ADMIT in resource_selectors.permissions_of(user):
        return True
    root = resource_selectors.root_of(resource_selectors.the_lab())
    return root.id in resource_selectors.allowed_ids(user, Permission.VIEW)


def visible_drivers(user: User, users: Mapping[UUID, object]) -> QuerySet[DriverVersion]:
    """Return the versions that a person may see: all, or those of the devices in `users`."""
    rows = selectors.drivers().defer("sources")
    return rows if _reads_all(user) else rows.filter(pk__in=list(users))


def visible_driver(version_id: UUID, user: User) -> DriverVersion:
    """Return a version that a person may see.

    Raises:
        NotFoundError: There is none, or no device in their part of the lab has it.
    """
    row = selectors.find_driver(version_id)
    if not is_driver_seen(row.id, user):
        raise NotFoundError(f"no driver version {version_id}", code="driver.not_found")
    return row


def is_driver_seen(version_id: UUID, user: User) -> bool:
    """Tell whether a person may see a version."""
    return _reads_all(user) or version_id in users_of(user)


def places_of(version: DriverVersion, user: User) -> list[DriverPlace]:
    """Return the devices that have a version of this driver, or are to have this one.

    Each with its host, the versions that it has and is to have, the job that acts, and
    whether the user may change its version. Retired devices are left out.
    """
    rows = [
        device
        for device in _visible(user)
        if device.state != Device.State.RETIRED
        and (device.driver.module == version.module or device.next_driver_id == version.pk)
    ]
    jobs = run_selectors.jobs_at_devices(device.id for device in rows)
    admitted = resource_selectors.allowed_ids(user, Permission.ADMIT)
    return [
        DriverPlace(
            id=device.id,
            key=device.key,
            name=device.name,
            state=device.state,
            host=DriverHost(
                id=device.host_id,
                name=device.host.name,
                state=SessionState(device.host.state),
            ),
            driver=driver_of(device),
            job=None
            if device.id not in jobs
            else DriverJob(
                id=jobs[device.id].id,
                run_id=jobs[device.id].run_id,
                run_number=jobs[device.id].run.number,
                sentence=jobs[device.id].sentence,
            ),
            can_change=selectors.node_ids(device) <= admitted,
        )
        for device in rows
    ]


def _visible(user: User) -> list[Device]:
    seen = resource_selectors.allowed_ids(user, Permission.VIEW)
    return selectors.visible_devices(resource_selectors.the_lab(), seen)
