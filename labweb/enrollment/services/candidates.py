"""Writes about what a person says of each thing that hosts see."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from django.db.models import Q
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import new_id, now
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.enrollment.admission_reason import is_text, refuse_no_reason
from labweb.domain.enrollment.driver_spec import DriverSpec, check_config
from labweb.domain.enrollment.host_join import LONGEST_NAME, is_code, is_name, key_of_name
from labweb.domain.errors import DefinitionError, EnrollmentError, StateError
from labweb.enrollment import selectors
from labweb.enrollment.models import Candidate, Device, DriverVersion
from labweb.enrollment.services.host_messages import tell_host
from labweb.enrollment.services.join_requests import require_admission
from labweb.resources import selectors as resource_selectors

_LONGEST_TRANSPORT = 300
"""As the column has room for."""


@atomic
def set_candidate_aside(candidate_id: UUID, state: str, *, reason: str, actor: User) -> Candidate:
    """Quarantine, ignore or reject a candidate, or take it back into the inbox.

    What other hosts would see in the same way (a key; model and serial number; a public
    address) is rejected, and taken back, in the whole lab: at every host that sees it, or will.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: The actor may not admit.
        DefinitionError: No reason was given, or this is no answer.
        StateError: It was taken up before, here or with the same key at another host: its
            device is where one says no.
    """
    row = _open_candidate(candidate_id, actor, reason)
    answer(row, state, reason=reason, actor=actor)
    return row


def answer(row: Candidate, state: str, *, reason: str, actor: User) -> None:
    """Give a candidate, which is locked with all that is alike, its answer; as above.

    Raises:
        DefinitionError: This is no answer.
        StateError: It is rejected, and another host's device in use has its key.
    """
    if state not in {"quarantined", "ignored", "rejected", "new"}:
        raise DefinitionError(f"{state!r:.40} is no answer", code="candidate.no_answer")
    rows = [row]
    if Candidate.State.REJECTED in {state, row.state}:
        rows += _elsewhere(row, state)
    for one in rows:
        one.state, one.reason = Candidate.State(state), reason
        one.decided_by, one.decided_at = actor, now()
        one.also_at, one.alone_since_at = "", None
        one.save()
        account_services.write_audit(f"device.{state}", str(one.id), actor=actor, reason=reason)
        on_commit(partial(feed.publish, "devices", {"candidate_id": str(one.id)}))


def _elsewhere(row: Candidate, state: str) -> list[Candidate]:
    """Lock and return what other hosts see in the same way, to be answered with it."""
    mark = selectors.shared_mark(row)
    if not mark:
        return []
    others = Candidate.objects.filter(lab=row.lab, mark=mark).exclude(pk=row.pk)
    found = list(others.order_by("pk").select_for_update(of=("self",), no_key=True))
    # Makers do give one serial number to many: a device of that number is no reason against it.
    taken = next((one for one in found if row.public_key and _is_in_use(one)), None)
    if state == Candidate.State.REJECTED and taken is not None:
        name = taken.device.name if taken.device is not None else taken.name
        text = f"its key is that of {name}, which was taken up: reject, suspend or retire that one"
        raise StateError(text, code="candidate.key_in_use")
    return [
        one
        for one in found
        if one.state != Candidate.State.TAKEN_UP and Candidate.State.REJECTED in {state, one.state}
    ]


def _is_in_use(one: Candidate) -> bool:
    """Tell whether a candidate became a device that is not retired."""
    is_retired = one.device is not None and one.device.state == Device.State.RETIRED
    return one.state == Candidate.State.TAKEN_UP and not is_retired


def _open_candidate(candidate_id: UUID, actor: User, reason: str) -> Candidate:
    row = hold_candidate(selectors.find_candidate(candidate_id))
    require_admission(actor, row.lab)
    refuse_no_reason(reason, "say what you checked", code="device.no_reason")
    if row.state == Candidate.State.TAKEN_UP:
        raise StateError("it was taken up before: see its device", code="candidate.taken_up")
    return row


def hold_candidate(row: Candidate) -> Candidate:
    """Lock and return a candidate with all that may be answered with it.

    That is what is alike, what it says it is, and what says that it is it. All in one order and
    before any device: two who answer wait for each other, and so do hosts that see them.
    """
    wanted = Q(pk=row.pk) | Q(pk=row.key_changed_from_id) | Q(key_changed_from=row.pk)
    mark = selectors.shared_mark(row)
    if mark:
        wanted |= Q(lab=row.lab, mark=mark)
    rows = Candidate.objects.filter(wanted)
    locked = rows.order_by("pk").select_for_update(of=("self",), no_key=True)
    return next(one for one in locked if one.pk == row.pk)


class WantedDevice(msgspec.Struct, frozen=True, kw_only=True):
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


def take_up(
    candidate_id: UUID, wanted: WantedDevice, *, typed: str, reason: str, actor: User
) -> Device:
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
        DefinitionError: No reason was given.
        EnrollmentError: The code differs.
    """
    row = selectors.find_candidate(candidate_id)
    require_admission(actor, row.lab)
    refuse_no_reason(reason, "say what you checked", code="device.no_reason")
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
def take_up_compared(
    candidate_id: UUID, wanted: WantedDevice, *, reason: str, actor: User
) -> Device:
    """Make a device of a candidate whose code was compared; as `take_up`, and raises as it."""
    row = _open_candidate(candidate_id, actor, reason)
    said = selectors.rejection_of(row.lab_id, selectors.shared_mark(row))
    if row.state == Candidate.State.REJECTED or said is not None:
        where = "" if said is None or said.host_id == row.host_id else f" at {said.host.name}"
        raise StateError(f"it was rejected{where}: take it back first", code="candidate.rejected")
    _refuse_unkept(wanted)
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
    row.also_at = ""
    row.save()
    detail = {"device_id": str(device.id), "label": wanted.label}
    account_services.write_audit(
        "device.taken_up", str(row.id), actor=actor, reason=reason, detail=detail
    )
    on_commit(partial(feed.publish, "devices", {"device_id": str(device.id)}))
    return device


def _refuse_unkept(wanted: WantedDevice) -> None:
    """Refuse what no record can hold, and a name that nobody can tell from another."""
    config = json.dumps(wanted.config)
    if not is_text(wanted.driver_digest, wanted.label) or "\\u0000" in config:
        raise DefinitionError(
            "label or settings hold the sign of code 0, which no text has: write them again",
            code="candidate.incomplete",
        )
    if wanted.name and not is_name(wanted.name):
        text = f"the name has 1 to {LONGEST_NAME} legible signs, a letter or digit among them"
        raise DefinitionError(text, code="candidate.incomplete")
    if len(wanted.transport) > _LONGEST_TRANSPORT or not wanted.transport.isprintable():
        text = f"the address of the carrier has at most {_LONGEST_TRANSPORT} printable signs"
        raise DefinitionError(text, code="candidate.incomplete")


def give_parts(
    device: Device, nodes: Mapping[str, UUID], *, past: Mapping[str, UUID] | None = None
) -> None:
    """Say through which resources a device acts, when they came with it; the caller made them.

    Args:
        device: Which.
        nodes: By role.
        past: What it acted through and has lost with a version of its driver; it may come back.
    """
    device.nodes = {role: str(node) for role, node in nodes.items()}
    device.past_nodes |= {role: str(node) for role, node in (past or {}).items()}
    device.save(update_fields=["nodes", "past_nodes"])


def _device_of(row: Candidate, key: str) -> Device:
    """Return the device whose key has changed, or a new one."""
    before = row.key_changed_from
    known = None if before is None else before.device
    if before is not None and known is not None and known.state != Device.State.RETIRED:
        device = selectors.device_for_update(known.pk)
        Candidate.objects.filter(pk=before.pk).update(device=None)
        if device.state == Device.State.ENROLLED:
            # A person says that its key has changed, before labweb was sure of it.
            device.state = Device.State.SUSPENDED
            on_commit(partial(tell_host, device.host_id, {"type": "edge.renew"}))
        device.host, device.suspended_for = row.host, ""
        return device
    taken = Device.objects.filter(lab=row.lab, key=key).first()
    if taken is not None:
        is_over = taken.state == Device.State.RETIRED
        text = "which is retired, and its records keep that name" if is_over else "which is in use"
        text = f"there is a device {key}, {text}: choose another name"
        raise StateError(text, code="device.name_taken")
    return Device(id=new_id(), lab=row.lab, host=row.host, key=key, state=Device.State.CANDIDATE)


def _check_nodes(nodes: Mapping[str, UUID], row: Candidate, actor: User) -> None:
    """Refuse resources that are not this lab's, or where the actor may not admit."""
    found = resource_selectors.rows(nodes.values()).filter(lab=row.lab)
    if found.count() != len(set(nodes.values())):
        raise DefinitionError("it belongs to resources that are not here", code="candidate.nodes")
    if nodes:
        resource_selectors.require(actor, Permission.ADMIT, nodes.values())
