"""Writes about what hosts see: the inbox, and what a person says of each."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from django.db.models import F
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import new_id, now
from labweb.domain.approvals.roles import Permission
from labweb.domain.enrollment.join import is_code, key_of_name
from labweb.domain.enrollment.sighting import MOST_OPEN, is_sane, mark_of
from labweb.domain.enrollment.spec import DriverSpec, check_config
from labweb.domain.errors import DefinitionError, EnrollmentError, StateError
from labweb.domain.messages import Sighting
from labweb.domain.messages.enrolling import MOST_SIGHTINGS_PER_FRAME
from labweb.enrollment import selectors
from labweb.enrollment.models import Candidate, Device, DriverVersion, EdgeHost
from labweb.enrollment.services.joining import require_admission
from labweb.enrollment.services.link import tell_host
from labweb.resources import selectors as resource_selectors

logger = logging.getLogger(__name__)

_OPEN = (Candidate.State.NEW, Candidate.State.QUARANTINED)


@atomic
def take_sightings(host_id: UUID, epoch: int, found: Sequence[Sighting]) -> int:
    """Keep what a host sees; nothing is added to the lab before a person has said so.

    Returns:
        How many are new in the inbox.

    Effect:
        None on matter. A device that was admitted with a key, and of which another key now
        speaks, is suspended at once: what it does runs to its end, nothing new is planned.
    """
    host = EdgeHost.objects.filter(pk=host_id, epoch=epoch).select_related("lab").first()
    if host is None:
        return 0
    fresh = 0
    for one in found[:MOST_SIGHTINGS_PER_FRAME]:
        if is_sane(one):
            fresh += _take(host, one)
    return fresh


def _take(host: EdgeHost, one: Sighting) -> int:
    mark = mark_of(one)
    seen: dict[str, Any] = {
        "address": one.address,
        "name": one.name,
        "model": one.model,
        "serial": one.serial,
        "last_seen_at": now(),
    }
    known = Candidate.objects.filter(host=host, mark=mark)
    if known.update(**seen, seen_count=F("seen_count") + 1):
        return 0
    if Candidate.objects.filter(host=host, state__in=_OPEN).count() >= MOST_OPEN:
        logger.warning("the inbox of %s is full: %s is left out", host.name, one.address)
        return 0
    before = _with_another_key(host, one)
    row = Candidate.objects.create(
        lab=host.lab,
        host=host,
        mark=mark,
        source=one.source,
        public_key=one.public_key,
        driver_hint=one.driver,
        first_seen_at=now(),
        key_changed_from=before,
        **seen,
    )
    detail = {"address": one.address, "name": one.name, "serial": one.serial}
    account_services.write_audit("device.seen", str(row.id), actor=None, detail=detail)
    if before is not None and before.device is not None:
        _suspend(before.device, row)
    on_commit(partial(feed.publish, "devices", {"candidate_id": str(row.id)}))
    return 1


def _with_another_key(host: EdgeHost, one: Sighting) -> Candidate | None:
    """Return the admitted candidate that this one says it is, and whose key it has not."""
    if not one.serial:
        return None
    rows = Candidate.objects.filter(
        lab=host.lab, model=one.model, serial=one.serial, device__isnull=False
    )
    return rows.exclude(public_key="").exclude(public_key=one.public_key).first()


def _suspend(device: Device, row: Candidate) -> None:
    reason = f"something at {row.address} says that it is this device, with another key"
    changed = Device.objects.filter(pk=device.pk, state=Device.State.ENROLLED).update(
        state=Device.State.SUSPENDED, suspended_for=reason
    )
    if changed:
        detail = {"candidate_id": str(row.id)}
        account_services.write_audit(
            "device.key_changed", str(device.id), actor=None, reason=reason, detail=detail
        )
        on_commit(partial(tell_host, device.host_id, {"type": "edge.renew"}))
        on_commit(partial(feed.publish, "devices", {"device_id": str(device.id)}))


@atomic
def set_candidate_aside(candidate_id: UUID, state: str, *, reason: str, actor: User) -> Candidate:
    """Quarantine, ignore or reject a candidate, or take it back into the inbox.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: The actor may not admit.
        DefinitionError: No reason was given, or this is no answer.
        StateError: It was taken up before: its device is where one says no.
    """
    row = _open_candidate(candidate_id, actor, reason)
    if state not in {"quarantined", "ignored", "rejected", "new"}:
        raise DefinitionError(f"{state!r:.40} is no answer", code="candidate.no_answer")
    row.state, row.reason = Candidate.State(state), reason
    row.decided_by, row.decided_at = actor, now()
    row.save(update_fields=["state", "reason", "decided_by", "decided_at"])
    account_services.write_audit(f"device.{state}", str(row.id), actor=actor, reason=reason)
    on_commit(partial(feed.publish, "devices", {"candidate_id": str(row.id)}))
    return row


def _open_candidate(candidate_id: UUID, actor: User, reason: str) -> Candidate:
    row = selectors.find_candidate(candidate_id)
    row = Candidate.objects.select_for_update(of=("self",)).get(pk=row.pk)
    require_admission(actor, row.lab)
    if not reason.strip():
        raise DefinitionError("say what you checked: the reason is empty", code="device.no_reason")
    if row.state == Candidate.State.TAKEN_UP:
        raise StateError("it was taken up before: see its device", code="candidate.taken_up")
    return row


class Wanted(msgspec.Struct, frozen=True, kw_only=True):
    """What a person says of a candidate: which device it is, and where."""

    name: str
    driver_digest: str
    transport: str
    """The carrier's URL with its options."""

    config: dict[str, Any] = msgspec.field(default_factory=dict)
    nodes: Mapping[str, UUID] = msgspec.field(default_factory=dict)
    """Role in the driver → resource."""

    label: str = ""
    """What stands on the thing itself."""


def take_up(candidate_id: UUID, wanted: Wanted, *, typed: str, reason: str, actor: User) -> Device:
    """Make a device of a candidate, to be reviewed: it may do nothing before it is admitted.

    Args:
        candidate_id: Which.
        wanted: What it is and where it belongs.
        typed: The code that the device shows; for one without a key, its serial number, and
            where it has none, its address.
        reason: What was checked.
        actor: Who says so.

    Raises:
        NotFoundError: There is no such candidate or driver.
        ForbiddenError: The actor may not admit there.
        EnrollmentError: The code differs. That is on record.
        DefinitionError: No reason, no name, or settings that do not fit the driver.
        StateError: It was taken up, or is rejected, or its name is taken.

    Effect:
        None on matter.
    """
    compare_code(candidate_id, typed=typed, reason=reason, actor=actor)
    return take_up_compared(candidate_id, wanted, reason=reason, actor=actor)


def compare_code(candidate_id: UUID, *, typed: str, reason: str, actor: User) -> None:
    """Refuse what is not the candidate in front of the person, and put that on record.

    Call it outside any atomic block: the refusal would take the record back.

    Raises:
        NotFoundError: There is no such candidate.
        ForbiddenError: The actor may not admit there.
        EnrollmentError: The code differs.
    """
    row = selectors.find_candidate(candidate_id)
    require_admission(actor, row.lab)
    code = selectors.code_of_candidate(row)
    expected = code or row.serial or row.address
    is_same = is_code(typed, code) if code else typed.strip() == expected
    if not is_same:
        with atomic():
            account_services.write_audit(
                "device.code_differs", str(row.id), actor=actor, reason=reason
            )
        raise EnrollmentError(
            "what you typed differs: do not admit. Something may sit between you and this device",
            code="device.code_differs",
        )


@atomic
def take_up_compared(candidate_id: UUID, wanted: Wanted, *, reason: str, actor: User) -> Device:
    """Make a device of a candidate whose code was compared; as `take_up`, and raises as it."""
    row = _open_candidate(candidate_id, actor, reason)
    if row.state == Candidate.State.REJECTED:
        raise StateError("it was rejected: take it back first", code="candidate.rejected")
    driver = DriverVersion.objects.filter(digest=wanted.driver_digest).first()
    if driver is None:
        raise DefinitionError("choose one of the drivers that were read", code="candidate.driver")
    spec = msgspec.convert(driver.spec, DriverSpec)
    findings = check_config(spec, wanted.config)
    if findings:
        raise DefinitionError("the settings do not fit the driver", findings=findings)
    key = key_of_name(wanted.name)
    if not key or not wanted.transport.strip():
        text = "a device needs a name and the address of its carrier"
        raise DefinitionError(text, code="candidate.incomplete")
    device = _device_of(row, key)
    device.name, device.driver, device.transport = wanted.name, driver, wanted.transport.strip()
    device.config = dict(wanted.config)
    device.nodes = {role: str(node) for role, node in wanted.nodes.items()}
    _check_nodes(wanted.nodes, row, actor)
    device.save()
    row.state, row.device, row.label, row.reason = (
        Candidate.State.TAKEN_UP,
        device,
        wanted.label,
        reason,
    )
    row.decided_by, row.decided_at = actor, now()
    row.save()
    detail = {"device_id": str(device.id), "label": wanted.label}
    account_services.write_audit(
        "device.taken_up", str(row.id), actor=actor, reason=reason, detail=detail
    )
    on_commit(partial(feed.publish, "devices", {"device_id": str(device.id)}))
    return device


def give_parts(device: Device, nodes: Mapping[str, UUID]) -> None:
    """Say through which resources a device acts, when they came with it; the caller made them."""
    device.nodes = {role: str(node) for role, node in nodes.items()}
    device.save(update_fields=["nodes"])


def _device_of(row: Candidate, key: str) -> Device:
    """Return the device whose key has changed, or a new one."""
    before = row.key_changed_from
    if before is not None and before.device is not None:
        device = selectors.device_for_update(before.device.pk)
        Candidate.objects.filter(pk=before.pk).update(device=None)
        device.host, device.suspended_for = row.host, ""
        return device
    if Device.objects.filter(lab=row.lab, key=key).exists():
        raise StateError(f"there is a device {key}: choose another name", code="device.name_taken")
    return Device(id=new_id(), lab=row.lab, host=row.host, key=key, state=Device.State.CANDIDATE)


def _check_nodes(nodes: Mapping[str, UUID], row: Candidate, actor: User) -> None:
    """Refuse resources that are not this lab's, or where the actor may not admit."""
    found = resource_selectors.rows(nodes.values()).filter(lab=row.lab)
    if found.count() != len(set(nodes.values())):
        raise DefinitionError("it belongs to resources that are not here", code="candidate.nodes")
    if nodes:
        resource_selectors.require(actor, Permission.ADMIT, nodes.values())
