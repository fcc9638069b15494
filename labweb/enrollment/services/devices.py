"""Writes of devices and drivers: found, admitted, suspended."""

from __future__ import annotations

from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import now
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.enrollment.admission_reason import refuse_no_reason
from labweb.domain.enrollment.admitted_interface import Admission, check_admission
from labweb.domain.enrollment.device_review import KeptReview, check_kept
from labweb.domain.errors import DefinitionError, StateError
from labweb.enrollment import selectors
from labweb.enrollment.models import Device, DriverVersion
from labweb.enrollment.services.host_messages import tell_host
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


def found_device(
    lab: Lab,
    device_id: UUID,
    *,
    driver: DriverVersion,
    **fields: Any,  # noqa: ANN401 - column values
) -> Device:
    """Write a device that was found, or bring its address and driver up to date.

    Effect:
        None on matter. One that is known keeps the state it was given by a person, and the
        version of its driver that a person chose.
    """
    fields["driver"] = driver
    row = Device.objects.filter(pk=device_id).select_related("driver").first()
    if row is None:
        return Device.objects.create(id=device_id, lab=lab, **fields)
    if row.driver.origin == DriverVersion.Origin.UPLOAD:
        fields["driver"] = row.driver
    for name in ("transport", "driver", "config", "nodes", "name"):
        setattr(row, name, fields[name])
    row.save()
    return row


@atomic
def admit_device(
    device_id: UUID,
    *,
    actor: User,
    reason: str,
    admission: Admission | None = None,
    seen: str | None = None,
) -> Device:
    """Admit a candidate: from now on its actions may be planned and dispatched.

    Args:
        device_id: Which.
        actor: Who admits it.
        reason: What was checked.
        admission: Admitted actions with their limits, an empty one for reading only; None:
            all that the driver declares.
        seen: Digest of the driver whose actions the actor was shown; None: of no page.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: The actor may not admit where it stands.
        DefinitionError: No reason was given, or the admission does not fit the driver.
        StateError: It is no candidate and not suspended, or has another driver than was shown.

    Effect:
        None on matter. The host is told to open a new session and serve it.
    """
    row = selectors.device_for_update(device_id)
    check_review(row, actor, reason)
    _check_waiting(row)
    if seen is not None:
        _check_seen(row, seen)
    findings = check_admission(selectors.declared_spec(row), admission or {})
    if findings:
        raise DefinitionError(
            "the admission does not fit the driver", code="device.admission", findings=findings
        )
    row.state = Device.State.ENROLLED
    row.admitted_by = actor
    row.admitted_at = now()
    row.suspended_for = ""
    row.admitted_as = msgspec.to_builtins(selectors.present_of(row))
    row.admission = None if admission is None else {k: dict(v) for k, v in admission.items()}
    row.kept_review = {}
    row.save()
    detail = {"admission": row.admission, "look": _proof_of(row), "label": row.admitted_as["label"]}
    account_services.write_audit(
        "device.admit",
        str(row.id),
        actor=actor,
        reason=reason,
        detail=detail,
        meaning="admits the device with these actions and limits",
    )
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
    check_review(row, actor, reason)
    if row.state != Device.State.ENROLLED:
        raise StateError(f"{row.name} is {row.state}", code="device.not_enrolled")
    row.state, row.kept_review = Device.State.SUSPENDED, {}
    row.save(update_fields=["state", "kept_review"])
    account_services.write_audit("device.suspend", str(row.id), actor=actor, reason=reason)
    on_commit(partial(tell_host, row.host_id, {"type": "edge.renew"}))
    on_commit(partial(feed.publish, "devices", {"device_id": str(row.id)}))
    return row


@atomic
def keep_review(device_id: UUID, kept: KeptReview, *, actor: User) -> None:
    """Keep what a person has filled in of a review, for whoever goes on with it.

    Raises:
        NotFoundError: There is no such device.
        ForbiddenError: The actor may not admit where it stands.
        DefinitionError: `device.bad_review`.
        StateError: It is no candidate and not suspended, or has another driver than was shown.

    Effect:
        None on matter; nothing is admitted.
    """
    row = selectors.device_for_update(device_id)
    resource_selectors.require(actor, Permission.ADMIT, selectors.node_ids(row))
    _check_waiting(row)
    _check_seen(row, kept.digest)
    check_kept(kept, selectors.declared_spec(row))
    noted = msgspec.structs.replace(kept, by=actor.printed_name, at_s=now().timestamp())
    row.kept_review = msgspec.to_builtins(noted)
    row.save(update_fields=["kept_review"])


def _proof_of(row: Device) -> dict[str, Any] | None:
    """Return the look that an admission could rest on, with what it has not proved."""
    look = selectors.last_look(row)
    checks = [] if look is None else selectors.checks_of(look)
    if look is None or not checks:
        return None
    return {"id": str(look.id), "failed": [one.name for one in checks if not one.is_passed]}


def check_review(row: Device, actor: User, reason: str) -> None:
    """Refuse who may not decide about a device, and a decision without a reason.

    Raises:
        ForbiddenError: The actor may not admit where it stands.
        DefinitionError: No reason was given, or one that is no text.
    """
    resource_selectors.require(actor, Permission.ADMIT, selectors.node_ids(row))
    refuse_no_reason(reason, "say what you checked", code="device.no_reason")


def _check_seen(row: Device, digest: str) -> None:
    if digest != row.driver.digest:
        raise StateError(
            "the driver of this device is not the one that the page showed: open the page again,"
            " and look at what it may do now",
            code="device.other_driver",
        )


def _check_waiting(row: Device) -> None:
    if row.state not in {Device.State.CANDIDATE, Device.State.SUSPENDED}:
        raise StateError(f"{row.name} is {row.state} already", code="device.not_candidate")
