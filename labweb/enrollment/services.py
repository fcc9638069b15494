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
from labweb.domain.runs.session import HostRecord, SessionState, decide_hello, state_by_silence
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
        is_revoked=row.state == SessionState.REVOKED.value,
    )


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
    answer = decide_hello(record_of(row), hello)
    if answer.kind == "refuse":
        raise EnrollmentError(answer.message, code=answer.code)
    row.epoch += 1
    row.session_id = new_id()
    row.last_seen_at = row.state_at = now()
    if answer.kind == "normal":
        row.journal_id = hello.journal_id
        row.state = SessionState.SYNCING.value
    else:
        row.state = SessionState.QUARANTINED.value
        row.heartbeat = {"code": answer.code, "message": answer.message}
    row.save()
    on_commit(partial(feed.publish, "hosts", {"host_id": str(row.id)}))
    return welcome_of(row, "normal" if answer.kind == "normal" else "quarantine")


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


def beat(host_id: UUID, epoch: int, heartbeat: Mapping[str, Any]) -> bool:
    """Record a sign of life.

    Returns:
        False when the session is not this one any more; the connection is to be closed.
    """
    rows = EdgeHost.objects.filter(pk=host_id, epoch=epoch)
    if not rows.update(last_seen_at=now(), heartbeat=dict(heartbeat)):
        return False
    back = rows.filter(state__in=[SessionState.SUSPECT.value, SessionState.ISOLATED.value])
    if back.update(state=SessionState.ONLINE.value, state_at=now()):
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
