"""Writes of hosts, devices and drivers: admission and sessions."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from datetime import datetime
from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from asgiref.sync import async_to_sync
from channels.layers import get_channel_layer
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed, signing
from labweb.common.clock import new_id, now
from labweb.domain.approvals.roles import Permission
from labweb.domain.enrollment.spec import DriverSpec
from labweb.domain.errors import DefinitionError, EnrollmentError, StateError
from labweb.domain.messages import Hello, Welcome, hello_bytes
from labweb.domain.runs.session import (
    HostRecord,
    SessionState,
    after_hello,
    decide_hello,
    quarantined,
    readmitted,
    state_by_beat,
    state_by_silence,
)
from labweb.enrollment import selectors
from labweb.enrollment.models import Device, DriverVersion, EdgeHost
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


def host_group(host_id: UUID) -> str:
    """Return the channel-layer group of a host's live connection."""
    return f"edge.{host_id.hex}"


def tell_host(host_id: UUID, message: Mapping[str, Any]) -> None:
    """Send to a host's live connection; lost when there is none."""
    layer = get_channel_layer()
    if layer is not None:
        async_to_sync(layer.group_send)(host_group(host_id), dict(message))


def keep_driver(spec: DriverSpec) -> DriverVersion:
    """Record a driver version that was read; the same digest is the same version."""
    row, _ = DriverVersion.objects.get_or_create(
        digest=spec.digest,
        defaults={
            "module": spec.module,
            "class_name": spec.class_name,
            "role": spec.role,
            "spec": msgspec.to_builtins(spec),
        },
    )
    return row


def add_host(lab: Lab, *, key: str, name: str, host_id: UUID, public_key: str) -> EdgeHost:
    """Write an admitted host; one that is known keeps its journal and key."""
    row, _ = EdgeHost.objects.get_or_create(
        lab=lab,
        key=key,
        defaults={"id": host_id, "name": name, "public_key": public_key},
    )
    return row


def found_device(
    lab: Lab,
    device_id: UUID,
    *,
    driver: DriverVersion,
    **fields: Any,  # noqa: ANN401 - column values
) -> Device:
    """Write a device that was found, or bring its address and driver up to date.

    Effect:
        None on matter. One that is known keeps the state it was given by a person.
    """
    fields["driver"] = driver
    row = Device.objects.filter(pk=device_id).first()
    if row is None:
        return Device.objects.create(id=device_id, lab=lab, **fields)
    for name in ("transport", "driver", "config", "nodes", "name"):
        setattr(row, name, fields[name])
    row.save()
    return row


def read_catalog() -> dict[str, DriverSpec]:
    """Return every driver of the package by `module:Class`, read as text by another process.

    Raises:
        EnrollmentError: The catalog could not be read.
    """
    done = subprocess.run(
        [sys.executable, "-m", "drivers.catalog", "--json"],
        capture_output=True,
        check=False,
        timeout=60,
    )
    if done.returncode:
        raise EnrollmentError(
            f"the driver catalog failed: {done.stderr.decode(errors='replace')[-500:]}",
            code="driver.catalog_failed",
        )
    specs = msgspec.json.decode(done.stdout, type=_Catalog).drivers
    return {f"{spec.module}:{spec.class_name}": spec for spec in specs}


class _Catalog(msgspec.Struct):
    drivers: list[DriverSpec]


@atomic
def admit_device(device_id: UUID, *, actor: User, reason: str) -> Device:
    """Admit a candidate: from now on its actions may be planned and dispatched.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: The actor may not admit where it stands.
        DefinitionError: No reason was given.
        StateError: It is no candidate and not suspended.

    Effect:
        None on matter. The host is told to open a new session and serve it.
    """
    row = selectors.device_for_update(device_id)
    _check_review(row, actor, reason)
    if row.state not in {Device.State.CANDIDATE, Device.State.SUSPENDED}:
        raise StateError(f"{row.name} is {row.state} already", code="device.not_candidate")
    row.state = Device.State.ENROLLED
    row.admitted_by = actor
    row.admitted_at = now()
    row.save(update_fields=["state", "admitted_by", "admitted_at"])
    account_services.write_audit("device.admit", str(row.id), actor=actor, reason=reason)
    on_commit(partial(tell_host, row.host_id, {"type": "edge.renew"}))
    on_commit(partial(feed.publish, "devices", {"device_id": str(row.id)}))
    return row


@atomic
def suspend_device(device_id: UUID, *, actor: User, reason: str) -> Device:
    """Take a device out of service without forgetting it.

    Raises:
        ForbiddenError: The actor may not admit where it stands.
        DefinitionError: No reason was given.
        StateError: It is not enrolled.

    Effect:
        None on matter. What the device does now runs to its end; nothing new is planned.
    """
    row = selectors.device_for_update(device_id)
    _check_review(row, actor, reason)
    if row.state != Device.State.ENROLLED:
        raise StateError(f"{row.name} is {row.state}", code="device.not_enrolled")
    row.state = Device.State.SUSPENDED
    row.save(update_fields=["state"])
    account_services.write_audit("device.suspend", str(row.id), actor=actor, reason=reason)
    on_commit(partial(tell_host, row.host_id, {"type": "edge.renew"}))
    on_commit(partial(feed.publish, "devices", {"device_id": str(row.id)}))
    return row


def _check_review(row: Device, actor: User, reason: str) -> None:
    resource_selectors.require(actor, Permission.ADMIT, selectors.node_ids(row))
    if not reason.strip():
        raise DefinitionError("say what you checked: the reason is empty", code="device.no_reason")


def record_of(row: EdgeHost) -> HostRecord:
    """Return what the rules of the handshake need."""
    return HostRecord(
        host_id=row.id,
        journal_id=row.journal_id,
        acked_seq=row.acked_seq,
        hash_at_acked=row.hash_at_acked,
        epoch=row.epoch,
        last_dseq=row.last_dseq,
        floor=row.floor,
        is_revoked=row.state == SessionState.REVOKED.value,
        quarantine=_quarantine_of(row),
    )


def _quarantine_of(row: EdgeHost) -> str:
    if row.state != SessionState.QUARANTINED.value:
        return ""
    return str(row.heartbeat.get("code", "host.quarantined"))


def _keep_record(row: EdgeHost, record: HostRecord) -> None:
    row.journal_id = record.journal_id
    row.acked_seq = record.acked_seq
    row.hash_at_acked = record.hash_at_acked
    row.epoch = record.epoch
    row.floor = record.floor


def quarantine_host(row: EdgeHost, code: str, message: str) -> None:
    """End a host's session and void all it was given; only a readmission lets it in again.

    Effect:
        None on matter. The caller puts its jobs in doubt in the same block.
    """
    _keep_record(row, quarantined(record_of(row), code))
    row.state = SessionState.QUARANTINED.value
    row.state_at = now()
    row.heartbeat = {"code": code, "message": message}
    row.save()
    on_commit(partial(feed.publish, "hosts", {"host_id": str(row.id)}))


@atomic
def readmit_host(host_id: UUID, *, actor: User, reason: str) -> EdgeHost:
    """Let a quarantined host begin again with a new journal.

    A person has been at the host: every process was down when its journal was set aside
    (`python -m workers.host reset-journal`), and what its vessels hold was looked at.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: The actor may not admit hosts.
        DefinitionError: No reason was given.
        StateError: It is not in quarantine.

    Effect:
        None on matter. Jobs in doubt stay so until a person answers for each.
    """
    row = selectors.host_for_update(host_id)
    root = resource_selectors.root_of(row.lab)
    resource_selectors.require(actor, Permission.ADMIT, [root.id])
    if not reason.strip():
        raise DefinitionError("say what you checked: the reason is empty", code="host.no_reason")
    if row.state != SessionState.QUARANTINED.value:
        raise StateError(f"{row.name} is {row.state}", code="host.not_quarantined")
    _keep_record(row, readmitted(record_of(row)))
    row.state = SessionState.ISOLATED.value
    row.state_at = now()
    row.heartbeat = {}
    row.save()
    account_services.write_audit("host.readmit", str(row.id), actor=actor, reason=reason)
    on_commit(partial(tell_host, row.id, {"type": "edge.renew"}))
    on_commit(partial(feed.publish, "hosts", {"host_id": str(row.id)}))
    return row


@atomic
def open_session(hello: Hello, nonce: str) -> Welcome:
    """Open a session for a host that proved its key, under a fresh epoch.

    Raises:
        EnrollmentError: Unknown host, wrong signature or revoked. Nothing changed.

    Effect:
        Commands of older epochs are void from now on.
    """
    known = selectors.find_host(hello.host_id)
    if known is None or not known.public_key:
        raise EnrollmentError("this host was never admitted", code="host.unknown")
    if not signing.is_signed_by(known.public_key, hello_bytes(hello, nonce), hello.signature):
        raise EnrollmentError("the signature is not this host's", code="host.bad_signature")
    row = selectors.host_for_update(hello.host_id)
    record = record_of(row)
    answer = decide_hello(record, hello)
    if answer.kind == "refuse":
        raise EnrollmentError(answer.message, code=answer.code)
    opening = after_hello(record, hello, answer)
    _keep_record(row, opening.record)
    row.state = opening.state.value
    row.session_id = new_id()
    row.last_seen_at = row.state_at = now()
    if opening.mode == "quarantine" and not record.quarantine:
        row.heartbeat = {"code": answer.code, "message": answer.message}
    row.save()
    on_commit(partial(feed.publish, "hosts", {"host_id": str(row.id)}))
    return welcome_of(row, opening.mode)


def welcome_of(row: EdgeHost, mode: str) -> Welcome:
    """Build the answer to a HELLO."""
    devices = row.devices.filter(state=Device.State.ENROLLED).select_related("driver")
    return Welcome(
        epoch=row.epoch,
        acked_seq=row.acked_seq,
        floor=row.floor,
        server_at_s=now().timestamp(),
        mode=mode,
        devices=[selectors.config_for_host(device) for device in devices],
        command_keys={signing.key_id(): signing.public_key()},
    )


def resume_host(host_id: UUID, epoch: int) -> None:
    """Mark a host that has caught up as online."""
    changed = EdgeHost.objects.filter(
        pk=host_id, epoch=epoch, state=SessionState.SYNCING.value
    ).update(state=SessionState.ONLINE.value, state_at=now())
    if changed:
        feed.publish("hosts", {"host_id": str(host_id)})


def beat(
    host_id: UUID, epoch: int, heartbeat: Mapping[str, Any], *, is_resumed: bool = True
) -> bool:
    """Record a sign of life.

    Args:
        host_id: Who.
        epoch: Session it was sent in.
        heartbeat: What it says.
        is_resumed: The server has read the host's log to its end in this session.

    Returns:
        False when the session is not this one any more; the connection is to be closed.
    """
    rows = EdgeHost.objects.filter(pk=host_id, epoch=epoch)
    row = rows.first()
    if row is None:
        return False
    changes: dict[str, Any] = {"last_seen_at": now()}
    if row.state != SessionState.QUARANTINED.value:
        # In quarantine the reason stands there.
        changes["heartbeat"] = dict(heartbeat)
    if not rows.update(**changes):
        return False
    state = state_by_beat(SessionState(row.state), is_resumed=is_resumed)
    if state.value != row.state and rows.filter(state=row.state).update(
        state=state.value, state_at=now()
    ):
        feed.publish("hosts", {"host_id": str(host_id)})
    return True


def watch_hosts(silent_since: Mapping[UUID, float]) -> list[UUID]:
    """Move hosts that fell silent to SUSPECT and ISOLATED; monotonic seconds only.

    Args:
        silent_since: Seconds without a sign of life, by host.
    """
    moved = []
    for row in EdgeHost.objects.filter(pk__in=list(silent_since)):
        state = state_by_silence(SessionState(row.state), silent_since[row.id])
        if state.value != row.state:
            EdgeHost.objects.filter(pk=row.id, state=row.state).update(
                state=state.value, state_at=now()
            )
            feed.publish("hosts", {"host_id": str(row.id)})
            moved.append(row.id)
    return moved


def acknowledge_stop(host_id: UUID, stop_id: UUID, at: datetime) -> None:
    """Record that a host has latched a software stop."""
    EdgeHost.objects.filter(pk=host_id).update(stop_acknowledged=stop_id, stop_acknowledged_at=at)
    feed.publish("lab", {"stop_acknowledged": str(host_id)})
