"""Writes of devices and drivers: found, admitted, suspended."""

from __future__ import annotations

from functools import partial
from typing import Any
from uuid import UUID

from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import now
from labweb.domain.approvals.roles import Permission
from labweb.domain.enrollment.admission import Admission, check_admission
from labweb.domain.errors import DefinitionError, StateError
from labweb.enrollment import selectors
from labweb.enrollment.models import Device, DriverVersion
from labweb.enrollment.services.link import tell_host
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
    device_id: UUID, *, actor: User, reason: str, admission: Admission | None = None
) -> Device:
    """Admit a candidate: from now on its actions may be planned and dispatched.

    Args:
        device_id: Which.
        actor: Who admits it.
        reason: What was checked.
        admission: Admitted actions with their limits, an empty one for reading only; None:
            all that the driver declares.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: The actor may not admit where it stands.
        DefinitionError: No reason was given, or the admission does not fit the driver.
        StateError: It is no candidate and not suspended.

    Effect:
        None on matter. The host is told to open a new session and serve it.
    """
    row = selectors.device_for_update(device_id)
    _check_review(row, actor, reason)
    if row.state not in {Device.State.CANDIDATE, Device.State.SUSPENDED}:
        raise StateError(f"{row.name} is {row.state} already", code="device.not_candidate")
    findings = check_admission(selectors.declared_spec(row), admission or {})
    if findings:
        raise DefinitionError(
            "the admission does not fit the driver", code="device.admission", findings=findings
        )
    row.state = Device.State.ENROLLED
    row.admitted_by = actor
    row.admitted_at = now()
    row.suspended_for = ""
    row.admission = None if admission is None else {k: dict(v) for k, v in admission.items()}
    row.save()
    detail = {"admission": row.admission, "look": _proof_of(row)}
    account_services.write_audit(
        "device.admit", str(row.id), actor=actor, reason=reason, detail=detail
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
    _check_review(row, actor, reason)
    if row.state != Device.State.ENROLLED:
        raise StateError(f"{row.name} is {row.state}", code="device.not_enrolled")
    row.state = Device.State.SUSPENDED
    row.save(update_fields=["state"])
    account_services.write_audit("device.suspend", str(row.id), actor=actor, reason=reason)
    on_commit(partial(tell_host, row.host_id, {"type": "edge.renew"}))
    on_commit(partial(feed.publish, "devices", {"device_id": str(row.id)}))
    return row


def _proof_of(row: Device) -> dict[str, Any] | None:
    """Return the look that an admission could rest on, with what it has not proved."""
    look = selectors.last_look(row)
    checks = [] if look is None else selectors.checks_of(look)
    if look is None or not checks:
        return None
    return {"id": str(look.id), "failed": [one.name for one in checks if not one.is_passed]}


def _check_review(row: Device, actor: User, reason: str) -> None:
    resource_selectors.require(actor, Permission.ADMIT, selectors.node_ids(row))
    if not reason.strip():
        raise DefinitionError("say what you checked: the reason is empty", code="device.no_reason")
