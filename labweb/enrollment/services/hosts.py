"""Writes of hosts: sessions, signs of life, quarantine and the way out of it."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from functools import partial
from typing import Any
from uuid import UUID

from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import disk, feed
from labweb.common.clock import new_id, now, tick
from labweb.common.dispatcher_wakeup import wake_dispatcher
from labweb.common.signatures import signing
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.disk_space import DiskRoomLevel
from labweb.domain.enrollment.admission_reason import refuse_no_reason
from labweb.domain.errors import EnrollmentError, StateError
from labweb.domain.messages.devices_and_drivers import DeviceConfig, DevicesFrame
from labweb.domain.messages.protocol_version import PROTOCOL_VERSION, version_refusal
from labweb.domain.messages.session import Hello, Welcome, hello_bytes
from labweb.domain.runs.host_link.host_session import (
    HostRecord,
    SessionState,
    after_hello,
    decide_hello,
    heard,
    pace_refusal,
    quarantined,
    readmitted,
    state_by_beat,
    state_by_silence,
)
from labweb.enrollment import selectors
from labweb.enrollment.models import Device, EdgeHost
from labweb.enrollment.services.certificates import check_certificate, note_use
from labweb.enrollment.services.host_messages import tell_host
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab

CLOSED = frozenset({SessionState.QUARANTINED.value, SessionState.FENCED.value})
"""States that only a person ends."""


def add_host(lab: Lab, *, key: str, name: str, host_id: UUID, public_key: str) -> EdgeHost:
    """Write an admitted host; one that is known keeps its journal and key."""
    row, _ = EdgeHost.objects.get_or_create(
        lab=lab,
        key=key,
        defaults={"id": host_id, "name": name, "public_key": public_key},
    )
    return row


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
        epoch_seen=row.epoch_seen,
        boots=tuple(row.boots),
        is_revoked=row.state == SessionState.REVOKED.value,
        quarantine=_quarantine_of(row),
    )


def _quarantine_of(row: EdgeHost) -> str:
    if row.state not in CLOSED:
        return ""
    return str(row.heartbeat.get("code", "host.quarantined"))


def keep_record(row: EdgeHost, record: HostRecord) -> None:
    """Put what the rules said into the row; the caller saves it."""
    row.journal_id = record.journal_id
    row.acked_seq = record.acked_seq
    row.hash_at_acked = record.hash_at_acked
    row.epoch = record.epoch
    row.epoch_seen = record.epoch_seen
    row.boots = list(record.boots)
    row.floor = record.floor


def quarantine_host(row: EdgeHost, code: str, message: str) -> None:
    """End a host's session and void all it was given; only a readmission lets it in again.

    Effect:
        None on matter. The caller puts its jobs in doubt in the same block.
    """
    keep_record(row, quarantined(record_of(row), code))
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
        StateError: It is neither in quarantine nor fenced.

    Effect:
        None on matter. Jobs in doubt stay so until a person answers for each.
    """
    row = selectors.host_for_update(host_id)
    root = resource_selectors.root_of(row.lab)
    resource_selectors.require(actor, Permission.ADMIT, [root.id])
    refuse_no_reason(reason, "say what you checked", code="host.no_reason")
    if row.state not in CLOSED:
        raise StateError(f"{row.name} is {row.state}", code="host.not_quarantined")
    keep_record(row, readmitted(record_of(row)))
    row.state = SessionState.ISOLATED.value
    row.state_at = now()
    row.heartbeat = {}
    row.save()
    account_services.write_audit(
        "host.readmit",
        str(row.id),
        actor=actor,
        reason=reason,
        meaning="lets the host begin again with a new journal",
    )
    on_commit(partial(tell_host, row.id, {"type": "edge.renew"}))
    on_commit(partial(feed.publish, "hosts", {"host_id": str(row.id)}))
    return row


@atomic
def open_session(hello: Hello, nonce: str, certificate: bytes | None = None) -> Welcome:
    """Open a session for a host that proved its key, under a fresh epoch.

    Args:
        hello: Who it says it is.
        nonce: What it was asked to sign.
        certificate: DER form of the one that its connection was opened with, which the
            authority has signed; None: over loopback, without.

    Raises:
        EnrollmentError: Unknown host, another version of the protocol, wrong signature, no
            good certificate, revoked, or a pace that is not the lab's. Nothing changed.

    Effect:
        Commands of older epochs are void from now on.
    """
    known = selectors.find_host(hello.host_id)
    if known is None or not known.public_key:
        raise EnrollmentError("this host was never admitted", code="host.unknown")
    row = selectors.host_for_update(hello.host_id)
    key = check_certificate(row, certificate)
    # Before the signature, which covers what only the other version knows of.
    if text := version_refusal(host=hello.v, server=PROTOCOL_VERSION):
        raise EnrollmentError(text, code="host.version")
    if not signing.is_signed_by(key, hello_bytes(hello, nonce), hello.signature):
        raise EnrollmentError("the signature is not this host's", code="host.bad_signature")
    if text := pace_refusal(hello.pace, is_simulated=row.lab.mode == "sim"):
        raise EnrollmentError(text, code="host.pace")
    record = record_of(row)
    answer = decide_hello(record, hello, live_instance_id=_live_instance(row))
    if answer.kind == "refuse":
        raise EnrollmentError(answer.message, code=answer.code)
    opening = after_hello(record, hello, answer)
    keep_record(row, opening.record)
    row.state = opening.state.value
    row.session_id = new_id()
    row.instance_id = hello.instance_id
    row.pace = hello.pace
    row.last_seen_at = row.state_at = now()
    row.away_since_at = None
    if opening.mode == "quarantine" and not record.quarantine:
        row.heartbeat = {"code": answer.code, "message": answer.message}
    row.save()
    note_use(row, certificate)
    on_commit(partial(feed.publish, "hosts", {"host_id": str(row.id)}))
    return welcome_of(row, opening.mode)


def _live_instance(row: EdgeHost) -> str:
    """Return the process whose connection is open and not silent; empty: there is none."""
    is_heard = row.state in {SessionState.ONLINE.value, SessionState.SYNCING.value}
    return row.instance_id if is_heard and row.session_id is not None else ""


def is_session_open(host_id: UUID, epoch: int) -> bool:
    """Tell whether a connection still is the host's session, and the host not revoked."""
    rows = EdgeHost.objects.filter(pk=host_id, epoch=epoch)
    return rows.exclude(state=SessionState.REVOKED.value).exists()


def close_session(host_id: UUID, epoch: int) -> None:
    """Note that the connection of a session is closed; a newer session is left alone."""
    EdgeHost.objects.filter(pk=host_id, epoch=epoch).update(session_id=None)


def welcome_of(row: EdgeHost, mode: str) -> Welcome:
    """Build the answer to a HELLO."""
    devices = row.devices.filter(state=Device.State.ENROLLED).select_related("driver")
    return Welcome(
        epoch=row.epoch,
        acked_seq=row.acked_seq,
        floor=row.floor,
        server_at_s=now().timestamp(),
        tick=tick(),
        mode=mode,
        devices=[selectors.config_for_host(device) for device in devices],
        staged=staged_of(row),
        command_keys={signing.key_id(): signing.public_key()},
    )


def staged_of(row: EdgeHost) -> list[DeviceConfig]:
    """Return the devices that shall have another version of their driver, with that version."""
    rows = selectors.staged_devices(row)
    return [selectors.config_for_host(device, device.next_driver) for device in rows]


def devices_of(host_id: UUID, epoch: int) -> DevicesFrame | None:
    """Return what a host serves and makes ready now; None: there is no such host."""
    row = selectors.find_host(host_id)
    if row is None:
        return None
    devices = row.devices.filter(state=Device.State.ENROLLED).select_related("driver")
    return DevicesFrame(
        epoch=epoch,
        devices=[selectors.config_for_host(device) for device in devices],
        staged=staged_of(row),
    )


def resume_host(host_id: UUID, epoch: int) -> None:
    """Mark a host that has caught up as online."""
    changed = EdgeHost.objects.filter(
        pk=host_id, epoch=epoch, state=SessionState.SYNCING.value
    ).update(state=SessionState.ONLINE.value, state_at=now())
    if changed:
        wake_dispatcher()
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
    at = now()
    changes: dict[str, Any] = {"last_seen_at": at, "epoch_seen": heard(record_of(row)).epoch_seen}
    if row.state not in CLOSED:
        # In quarantine the reason stands there.
        changes["heartbeat"] = dict(heartbeat)
    wall_s = heartbeat.get("wall_s")
    if isinstance(wall_s, int | float) and not isinstance(wall_s, bool) and abs(wall_s) < 1e12:
        changes["clock_skew_s"] = round(wall_s - at.timestamp(), 3)
    if not rows.update(**changes):
        return False
    if "heartbeat" in changes:
        for device_id in sorted(_halts_owed(row.heartbeat) ^ _halts_owed(heartbeat)):
            feed.publish("devices", {"device_id": device_id})
        if _disk_level(row.heartbeat) is not _disk_level(heartbeat):
            feed.publish("hosts", {"host_id": str(host_id)})
    state = state_by_beat(SessionState(row.state), is_resumed=is_resumed)
    if state.value != row.state and rows.filter(state=row.state).update(
        state=state.value, state_at=now(), away_since_at=None
    ):
        feed.publish("hosts", {"host_id": str(host_id)})
    return True


def _disk_level(heartbeat: Mapping[str, Any]) -> DiskRoomLevel | None:
    found = selectors.disk_of("", heartbeat)
    return None if found is None else found.level(disk.floors())


def _halts_owed(heartbeat: Mapping[str, Any]) -> set[str]:
    return set(heartbeat.get("halts_owed", ()))


def note_serving(host_id: UUID, epoch: int, serving: Mapping[str, str]) -> None:
    """Write down which version of its driver serves each device of a host, as the host says it."""
    if not EdgeHost.objects.filter(pk=host_id, epoch=epoch).exists():
        return
    for device in Device.objects.filter(host_id=host_id):
        digest = serving.get(str(device.id), "")[:64]
        if digest == device.serving.get("digest", ""):
            continue
        at = now().isoformat()
        told = {"digest": digest, "host_id": str(host_id), "at": at} if digest else {}
        Device.objects.filter(pk=device.pk).update(serving=told)
        feed.publish("devices", {"device_id": str(device.id)})


def watch_hosts(silent_since: Mapping[UUID, float]) -> list[UUID]:
    """Move hosts that fell silent to SUSPECT and ISOLATED; monotonic seconds only.

    Args:
        silent_since: Seconds without a sign of life, by host.
    """
    moved = []
    for row in EdgeHost.objects.filter(pk__in=list(silent_since)):
        state = state_by_silence(SessionState(row.state), silent_since[row.id])
        if state.value != row.state:
            is_alone = state is SessionState.ISOLATED
            EdgeHost.objects.filter(pk=row.id, state=row.state).update(
                state=state.value,
                state_at=now(),
                away_since_at=row.last_seen_at if is_alone else None,
            )
            feed.publish("hosts", {"host_id": str(row.id)})
            moved.append(row.id)
    return moved


def acknowledge_stop(host_id: UUID, stop_id: UUID, at: datetime) -> None:
    """Record that a host has latched a software stop."""
    EdgeHost.objects.filter(pk=host_id).update(stop_acknowledged=stop_id, stop_acknowledged_at=at)
    feed.publish("lab", {"stop_acknowledged": str(host_id)})
