"""Give a device another version of its driver: staged, tried on its host, then switched.

```text
staged ──host has built it──▶ ready ──the device is idle──▶ switched
   └──────host refuses it──▶ the version before stays, with the reason
```

Until the switch the device is planned for, dispatched to and served with the version before.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any
from uuid import UUID

import msgspec
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import now
from labweb.domain.approvals.roles import Permission
from labweb.domain.enrollment.replacement import Waiting, check_replacement
from labweb.domain.enrollment.spec import DriverSpec
from labweb.domain.errors import DefinitionError, Finding, PreconditionError, StateError
from labweb.domain.graph.injection import check_parts
from labweb.enrollment import selectors
from labweb.enrollment.models import Device, DriverVersion, EdgeHost
from labweb.enrollment.services.link import tell_host
from labweb.resources import selectors as resource_selectors


@atomic
def want_driver(
    device_id: UUID, version_id: UUID, *, actor: User, reason: str, waiting: Sequence[Waiting]
) -> Device:
    """Say which version of its driver a device shall have; an earlier one rolls back.

    A device that its host does not serve gets it at once. To name the present version
    takes back what is staged.

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
    if not reason.strip():
        raise DefinitionError("say why: the reason is empty", code="driver.no_reason")
    # Locked: who withdraws it sees that this device is to have it, or this sees that it is gone.
    version = selectors.driver_for_update(version_id)
    if version.state != DriverVersion.State.APPROVED or not version.approval:
        raise StateError(f"{version} is {version.state}, not approved", code="driver.not_approved")
    if version.pk == device.driver_id and device.next_driver_id is None:
        raise StateError(f"{device.name} has {version} already", code="driver.known")
    if version.pk == device.next_driver_id:
        raise StateError(f"{device.name} is to have {version} already", code="driver.known")
    if findings := _findings(device, version, waiting):
        text = "; ".join(finding.message for finding in findings)
        raise PreconditionError(text, code="driver.does_not_fit", findings=findings)
    detail = {"from": device.driver.digest, "to": version.digest}
    account_services.write_audit(
        "driver.want", str(device.id), actor=actor, reason=reason, detail=detail
    )
    device.driver_problem = {}
    device.is_next_ready = False
    device.next_driver = None if version.pk == device.driver_id else version
    if device.state != Device.State.ENROLLED and device.next_driver is not None:
        device.driver, device.next_driver = version, None
    _save(device)
    return device


def _findings(device: Device, version: DriverVersion, waiting: Sequence[Waiting]) -> list[Finding]:
    old, new = selectors.spec_of(device), msgspec.convert(version.spec, DriverSpec)
    found = check_replacement(
        old,
        new,
        config=device.config,
        roles=device.nodes,
        admission=device.admission if device.state == Device.State.ENROLLED else None,
        waiting=waiting,
    )
    return found + check_parts(old, new, device.config)


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
    device.next_driver, device.is_next_ready = None, False
    device.driver_problem = _problem(body)
    _save(device)
    return device


def _problem(body: dict[str, Any]) -> dict[str, str]:
    fields = {name: str(body.get(name, ""))[:2000] for name in ("digest", "code", "message")}
    return fields | {"at": now().isoformat()}


def _staged(host: EdgeHost, device_id: UUID, digest: str) -> Device | None:
    rows = selectors.staged_devices(host).select_for_update(of=("self",))
    return rows.filter(pk=device_id, next_driver__digest=digest).first()


def switch_driver(device: Device, waiting: Sequence[Waiting]) -> bool:
    """Let the next version take over on a device that is idle; False: there is none ready.

    The caller has locked the host and seen that nothing acts. Should runs that began since
    need what the new version lacks, it is given up, and the device says so.
    """
    if not device.is_next_ready or device.next_driver is None:
        return False
    before, after = device.driver, device.next_driver
    detail: dict[str, Any] = {"from": before.digest, "to": after.digest}
    if findings := _findings(device, after, waiting):
        text = "; ".join(finding.message for finding in findings)
        detail |= {"code": "driver.does_not_fit", "message": text}
        account_services.write_audit("driver.refused", str(device.id), actor=None, detail=detail)
        device.driver_problem = _problem({**detail, "digest": after.digest})
    else:
        account_services.write_audit("driver.switch", str(device.id), actor=None, detail=detail)
        device.driver = after
    device.next_driver, device.is_next_ready = None, False
    _save(device)
    return True


def _save(device: Device) -> None:
    device.save(update_fields=["driver", "next_driver", "is_next_ready", "driver_problem"])
    on_commit(partial(tell_host, device.host_id, {"type": "edge.devices"}))
    on_commit(partial(feed.publish, "devices", {"device_id": str(device.id)}))
