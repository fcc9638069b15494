"""Give a device another version of its driver: staged, tried on its host, then switched.

```text
staged ──host has built it──▶ ready ──the device is idle──▶ switched
   └──────host refuses it──▶ the version before stays, with the reason
```

Until the switch the device is planned for, dispatched to and served with the version before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
from labweb.domain.enrollment.driver_replacement import PlannedJobAhead, check_replacement
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.errors import Finding, PreconditionError, StateError
from labweb.domain.graph.device_parts_changes import decision_of, find_changes, list_changes
from labweb.enrollment import selectors
from labweb.enrollment.models import Device, DriverVersion, EdgeHost
from labweb.enrollment.services.host_messages import tell_host
from labweb.resources import selectors as resource_selectors


@dataclass(frozen=True, slots=True)
class Decided:
    """What a person who was shown the parts that come and go has said."""

    parts: str = ""
    """The decision of `parts_of_version`."""

    against: Sequence[Finding] = ()
    """What speaks against these parts in the tree and the graph."""


@atomic
def want_driver(
    device_id: UUID,
    version_id: UUID,
    *,
    actor: User,
    reason: str,
    waiting: Sequence[PlannedJobAhead],
    decided: Decided | None = None,
) -> Device:
    """Say which version of its driver a device shall have; an earlier one rolls back.

    One that its host does not serve may be switched at once. To name the present version
    takes back what is staged.

    Args:
        device_id: Which.
        version_id: Which version.
        actor: Who says so.
        reason: Why.
        waiting: What runs that go on will still ask of it.
        decided: What was decided of its parts; None: no part changes with it.

    Raises:
        NotFoundError: There is no such device or version.
        ForbiddenError: The actor may not admit where the device stands.
        DefinitionError: No reason was given.
        StateError: The version is not approved, or the device has it.
        PreconditionError: It cannot serve this device; `findings` list why.

    Effect:
        None on matter. What acts runs to its end on the version before.
    """
    device = selectors.device_for_update(device_id)
    resource_selectors.require(actor, Permission.ADMIT, selectors.node_ids(device))
    refuse_no_reason(reason, "say why", code="driver.no_reason")
    # Locked: who withdraws it sees that this device is to have it, or this sees that it is gone.
    version = selectors.driver_for_update(version_id)
    _check_choice(device, version)
    decided = decided or Decided()
    is_back = version.pk == device.driver_id
    if (
        findings := []
        if is_back
        else [*_findings(device, version, waiting, decided.parts), *decided.against]
    ):
        text = "; ".join(finding.message for finding in findings)
        raise PreconditionError(text, code="driver.does_not_fit", findings=findings)
    detail = {"from": device.driver.digest, "to": version.digest, "parts": decided.parts}
    account_services.write_audit(
        "driver.want", str(device.id), actor=actor, reason=reason, detail=detail
    )
    device.driver_problem = {}
    device.next_driver = None if is_back else version
    device.is_next_ready = not is_back and device.state != Device.State.ENROLLED
    word = {"digest": decided.parts, "actor_id": str(actor.pk), "reason": reason.strip()}
    device.next_parts = word if decided.parts and not is_back else {}
    _save(device)
    return device


def _check_choice(device: Device, version: DriverVersion) -> None:
    if device.state == Device.State.RETIRED:
        raise StateError(f"{device.name} is retired: it gets no driver", code="device.retired")
    if version.state != DriverVersion.State.APPROVED or not version.approval:
        raise StateError(f"{version} is {version.state}, not approved", code="driver.not_approved")
    if version.pk == device.driver_id and device.next_driver_id is None:
        raise StateError(f"{device.name} has {version} already", code="driver.known")
    if version.pk == device.next_driver_id:
        raise StateError(f"{device.name} is to have {version} already", code="driver.known")


def parts_of_version(device: Device, version: DriverVersion) -> tuple[str, list[Finding]]:
    """Return which parts of a device come, go and change with a version, for a person to decide.

    Returns:
        What to hand back as the decision, empty when no part changes; and each change.
    """
    old, new = selectors.declared_spec(device), msgspec.convert(version.spec, DriverSpec)
    if not device.nodes:
        return "", []
    changes = find_changes(old, new, device.config, key=device.key, name=device.name)
    return decision_of(changes, new.class_name), list_changes(changes, new.class_name)


def _findings(
    device: Device, version: DriverVersion, waiting: Sequence[PlannedJobAhead], decided: str
) -> list[Finding]:
    old, new = selectors.spec_of(device), msgspec.convert(version.spec, DriverSpec)
    decision, changes = parts_of_version(device, version)
    is_decided = decision == decided
    found = check_replacement(
        old,
        new,
        config=device.config,
        roles=() if is_decided and changes else device.nodes,
        admission=device.admission if device.state == Device.State.ENROLLED else None,
        waiting=waiting,
    )
    return found if is_decided else [*found, *changes]


def note_ready(host: EdgeHost, device_id: UUID, digest: str) -> None:
    """Write down that a host has built the next version of a device's driver."""
    device = _staged(host, device_id, digest)
    if device is not None:
        device.is_next_ready = True
        device.save(update_fields=["is_next_ready"])
        on_commit(partial(feed.publish, "devices", {"device_id": str(device.id)}))


def note_refused(host: EdgeHost, device_id: UUID, body: dict[str, Any]) -> Device | None:
    """Write down that a host cannot build a version; the one before stays in its place.

    Returns:
        The device, None when the version was not wanted any more.
    """
    device = _staged(host, device_id, str(body.get("digest", "")))
    if device is None:
        return None
    account_services.write_audit(
        "driver.refused", str(device.id), actor=None, detail=_problem(body)
    )
    device.next_driver, device.is_next_ready, device.next_parts = None, False, {}
    device.driver_problem = _problem(body)
    _save(device)
    return device


def note_unserved(host: EdgeHost, device_id: UUID, body: dict[str, Any]) -> Device | None:
    """Write down that a host cannot load the very version that a device has: nothing serves it.

    Returns:
        The device, None when it has another version, or the host does not serve it.
    """
    rows = Device.objects.filter(host=host, driver__digest=str(body.get("digest", "")))
    device = rows.select_for_update(of=("self",), no_key=True).filter(pk=device_id).first()
    if device is not None:
        device.driver_problem = _problem(body)
        device.save(update_fields=["driver_problem"])
        on_commit(partial(feed.publish, "devices", {"device_id": str(device.id)}))
    return device


def note_served(host: EdgeHost, device_id: UUID, digest: str) -> None:
    """Take back that a host cannot load a version: it serves with it."""
    rows = Device.objects.filter(pk=device_id, host=host, driver_problem__digest=digest)
    if rows.update(driver_problem={}):
        on_commit(partial(feed.publish, "devices", {"device_id": str(device_id)}))


def _problem(body: dict[str, Any]) -> dict[str, str]:
    fields = {name: str(body.get(name, ""))[:2000] for name in ("digest", "code", "message")}
    return fields | {"at": now().isoformat()}


def _staged(host: EdgeHost, device_id: UUID, digest: str) -> Device | None:
    # Suspended ones too: what the server cannot switch would be tried again for ever.
    rows = Device.objects.filter(host=host).select_for_update(of=("self",), no_key=True)
    return (
        rows.filter(pk=device_id, next_driver__digest=digest)
        .select_related("driver", "next_driver", "lab")
        .first()
    )


Refitting = Callable[[Device, DriverVersion], Sequence[Finding]]
"""Gives a device the parts of a version, or nothing of it and lists what speaks against it."""


def switch_driver(device: Device, waiting: Sequence[PlannedJobAhead], refit: Refitting) -> bool:
    """Let the next version take over on a device that is idle; False: there is none ready.

    The caller has locked the host and seen that nothing acts. Should runs that began since
    need what the new version lacks, or the parts cannot follow, it is given up, and the
    device says so.
    """
    if not device.is_next_ready or device.next_driver is None:
        return False
    before, after = device.driver, device.next_driver
    detail: dict[str, Any] = {"from": before.digest, "to": after.digest}
    findings = _findings(device, after, waiting, device.next_parts.get("digest", ""))
    findings += [] if findings or not device.next_parts else refit(device, after)
    if findings:
        text = "; ".join(finding.message for finding in findings)
        detail |= {"code": "driver.does_not_fit", "message": text}
        account_services.write_audit("driver.refused", str(device.id), actor=None, detail=detail)
        device.driver_problem = _problem({**detail, "digest": after.digest})
    else:
        account_services.write_audit("driver.switch", str(device.id), actor=None, detail=detail)
        device.driver = after
    device.next_driver, device.is_next_ready, device.next_parts = None, False, {}
    _save(device)
    return True


def _save(device: Device) -> None:
    fields = ["driver", "next_driver", "is_next_ready", "next_parts", "driver_problem"]
    device.save(update_fields=fields)
    on_commit(partial(tell_host, device.host_id, {"type": "edge.devices"}))
    on_commit(partial(feed.publish, "devices", {"device_id": str(device.id)}))
