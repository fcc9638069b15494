"""Devices as pages show them: enrollment, link, job and readings together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, ClassVar
from uuid import UUID

import msgspec
from msgspec.structs import asdict
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import user_of
from labweb.common.answers import NamedRef
from labweb.common.clock import now
from labweb.common.lists import STANDING
from labweb.common.requests import Nothing, body
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.enrollment.admitted_interface import shows_itself
from labweb.domain.enrollment.driver_spec import UNITS, DriverSpec, StatusSpec
from labweb.domain.runs.halts.halt_progress import HaltState
from labweb.domain.runs.states.job_states import JobState
from labweb.enrollment import selectors as enrollment_selectors
from labweb.enrollment.selectors import Device
from labweb.fleet.answers.devices import (
    DeviceDetail,
    DeviceDriverUse,
    DeviceJob,
    DeviceLink,
    DeviceList,
    DevicePart,
    DeviceReading,
    DeviceRow,
    DeviceStatus,
    ShowingRun,
)
from labweb.fleet.api.driver_use import driver_of
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors as run_selectors
from labweb.runs import services as run_services
from labweb.runs.answers.runs import DeviceHaltRow
from labweb.runs.api.halts import render_halt
from labweb.runs.selectors import DeviceHalt, Job
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry.api import photo_told
from labweb.workflows.api.workflows import device_actions

_STALE_AFTER_S = 5.0


class Devices(Endpoint):
    """Devices of the lab."""

    queries = STANDING.parameters

    def get(self, request: Request) -> DeviceList:
        """List devices with their latest readings."""
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        lab = resource_selectors.the_lab()
        rows = enrollment_selectors.visible_present(lab, seen)
        found, following = STANDING.of_list(request, rows, lambda row: [row.key, row.pk.hex])
        return DeviceList(devices=device_rows(found), next=following)


class OneDevice(Endpoint):
    """One device."""

    def get(self, request: Request, device_id: UUID) -> DeviceDetail:
        """Return a device with its driver, actions and statuses."""
        seen = resource_selectors.allowed_ids(user_of(request), Permission.VIEW)
        row = enrollment_selectors.find_device(device_id, seen)
        spec = enrollment_selectors.spec_of(row)
        names = resource_selectors.names(UUID(node) for node in row.nodes.values())
        halt = run_selectors.last_halt(row.id)
        told = {"halt": None if halt is None else render_halt(halt)}
        return DeviceDetail(
            **(asdict(device_rows([row])[0]) | told),
            driver=DeviceDriverUse(
                **asdict(driver_of(row)),
                protocol=spec.protocol,
                quality=spec.quality,
                doc=spec.doc,
            ),
            actions=device_actions(spec),
            shows_itself=shows_itself(spec) and bool(row.nodes),
            statuses=[_status(status) for status in spec.statuses],
            config=row.config,
            nodes=[
                DevicePart(role=role, id=UUID(node), name=names.get(UUID(node), ""))
                for role, node in row.nodes.items()
                if UUID(node) in seen
            ],
            transport=row.transport,
            photo=photo_told(telemetry_selectors.newest_photo(row)),
        )


class ShowDevice(Endpoint):
    """The name of a device, on the device itself."""

    statuses: ClassVar = {"post": 201}

    def post(self, request: Request, showing_id: UUID) -> ShowingRun:
        """Start the run in which a device shows its name."""
        user = user_of(request)
        enrollment_selectors.visible_device(showing_id, user)
        run = run_services.show_device(showing_id, actor=user)
        return ShowingRun(run_id=run.id, number=run.number)


class StopDevice(Endpoint):
    """Software stop of one device."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Nothing}
    harmless: ClassVar[Mapping[str, str]] = {
        "post": "a device that is stopped twice stands; a stop is never refused for a missing key"
    }

    def post(self, request: Request, stopped_id: UUID) -> DeviceHaltRow:
        """Halt a device now, whether anything acts on it or not, and return what came of it."""
        body(request, Nothing)
        user = user_of(request)
        enrollment_selectors.visible_device(stopped_id, user)
        return render_halt(run_services.stop_device(stopped_id, actor=user))


def _status(status: StatusSpec) -> DeviceStatus:
    unit = UNITS[status.value.unit][1] if status.value.unit in UNITS else ""
    label = status.value.label or status.name
    return DeviceStatus(name=status.name, label=label, unit=unit, doc=status.doc)


def device_rows(devices: Iterable[Device]) -> list[DeviceRow]:
    """Render devices; a fixed number of queries."""
    rows = list(devices)
    latest = telemetry_selectors.latest(row.id for row in rows)
    jobs = run_selectors.jobs_at_devices(row.id for row in rows)
    halts = run_selectors.open_halts(row.id for row in rows)
    return [
        _device(row, latest.get(row.id, {}), jobs.get(row.id), halts.get(row.id)) for row in rows
    ]


def _device(
    row: Device,
    latest: dict[str, tuple[float, Any]],
    job: Job | None,
    halt: DeviceHalt | None,
) -> DeviceRow:
    is_owed = halt is not None and halt.state == HaltState.OWED
    spec = enrollment_selectors.spec_of(row)
    return DeviceRow(
        id=row.id,
        key=row.key,
        name=row.name,
        role=row.driver.role,
        kind_label=_kind_label(spec),
        host=NamedRef(id=row.host_id, name=row.host.name),
        state=row.state,
        link=_link(row, latest),
        is_halt_owed=is_owed or str(row.id) in row.host.heartbeat.get("halts_owed", ()),
        halt=None if halt is None else render_halt(halt),
        job=None
        if job is None
        else DeviceJob(
            id=job.id,
            run_id=job.run_id,
            run_number=job.run.number,
            sentence=job.sentence,
            state=JobState(job.state),
        ),
        readings=[
            DeviceReading(**asdict(_status(status)), status=status.name, value=value, at_s=at)
            for status in spec.statuses
            if status.name in latest
            for at, value in [latest[status.name]]
        ],
    )


def _kind_label(spec: DriverSpec) -> str:
    roles = [role for role in spec.roles if role != "showing"] or spec.roles
    label = " and ".join(role.replace("_", " ") for role in roles).capitalize()
    return label.replace("Ph ", "pH ")


def _link(row: Device, latest: dict[str, tuple[float, Any]]) -> DeviceLink:
    if row.state != Device.State.ENROLLED:
        return "not_enrolled"
    if row.host.state == "quarantined":
        return "quarantined"
    if row.host.state not in {"online", "suspect"}:
        return "offline"
    if not latest:
        return "online" if row.driver.role == "timer" else "stale"
    age = now().timestamp() - max(at for at, _ in latest.values())
    return "stale" if age > _STALE_AFTER_S and row.driver.role != "timer" else "online"
