"""Writes of driver versions: read, proposed, approved by a second person, withdrawn."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from functools import partial
from threading import BoundedSemaphore
from uuid import UUID

import msgspec
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import now
from labweb.common.limits.concurrency import give_back_connection
from labweb.common.signatures import signing
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.enrollment.admission_reason import refuse_no_reason
from labweb.domain.enrollment.driver_bundle import (
    MAX_BUNDLE_BYTES,
    PART_BYTES,
    digest_of,
    encode_bundle,
)
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.errors import (
    ConformanceError,
    DefinitionError,
    EnrollmentError,
    Finding,
    ForbiddenError,
    LockedError,
    StateError,
)
from labweb.domain.messages.devices_and_drivers import DriverApproval, DriverPart, Signed
from labweb.enrollment import selectors
from labweb.enrollment.models import DriverVersion
from labweb.resources import selectors as resource_selectors

INSPECT_WITHIN_S = 10.0
"""Longest time to wait for the reader; a text takes it less than a second of the processor."""

WAIT_S = 10.0
_AT_ONCE = BoundedSemaphore(2)
"""Texts that one server reads side by side: each may take a gigabyte for ten seconds."""

LONGEST_MODULE = 200
"""Most of a module's name that is passed on; no driver has one as long."""

_PASSED_ON = ("PATH", "PYTHONPATH", "LANG", "LC_ALL", "HOME", "SYSTEMROOT")
_State = DriverVersion.State


class CatalogDriver(msgspec.Struct, frozen=True):
    """One driver that was read, with the texts that its digest is of."""

    spec: DriverSpec
    sources: dict[str, str]


class _Catalog(msgspec.Struct):
    drivers: list[DriverSpec]
    findings: list[Finding]
    sources: dict[str, dict[str, str]]


def read_catalog() -> dict[str, CatalogDriver]:
    """Return every driver of the package by `module:Class`, read as text by another process.

    Raises:
        EnrollmentError: The catalog could not be read.
    """
    found = _read([], b"", 60.0)
    return {
        f"{spec.module}:{spec.class_name}": CatalogDriver(spec, found.sources[spec.digest])
        for spec in found.drivers
    }


def inspect_text(module: str, text: str) -> CatalogDriver:
    """Read the text of one driver in another process; nothing of it is executed.

    Raises:
        ConformanceError: It breaks a rule; `findings` list each place. Nothing was written.
        EnrollmentError: The reader failed, or took too long.
        LockedError: `driver.busy`.
    """
    give_back_connection()
    if not _AT_ONCE.acquire(timeout=WAIT_S):
        raise LockedError("other drivers are being read: try again", code="driver.busy")
    try:
        asked = ["-", f"--module={module[:LONGEST_MODULE]}"]
        found = _read(asked, text.encode(), INSPECT_WITHIN_S)
    finally:
        _AT_ONCE.release()
    findings = [*found.findings, *(one for spec in found.drivers for one in spec.findings)]
    if findings or len(found.drivers) != 1:
        count = len(findings)
        places = f"{count} place{'s' * (count != 1)}"
        text = f"{module[:LONGEST_MODULE]} breaks the rules of drivers in {places}"
        raise ConformanceError(text, findings=findings)
    (spec,) = found.drivers
    return CatalogDriver(spec, found.sources[spec.digest])


def _read(arguments: list[str], data: bytes, within_s: float) -> _Catalog:
    command = [sys.executable, "-m", "drivers.catalog", *arguments, "--json", "--sources"]
    environment = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    try:
        done = subprocess.run(
            command,
            input=data,
            env=environment,
            capture_output=True,
            check=False,
            timeout=within_s,
        )
    except subprocess.TimeoutExpired as error:
        text = f"reading the source took longer than {within_s:.0f} s"
        raise EnrollmentError(text, code="driver.catalog_failed") from error
    if done.returncode:
        raise EnrollmentError(
            f"the driver catalog failed: {done.stderr.decode(errors='replace')[-500:]}",
            code="driver.catalog_failed",
        )
    return msgspec.json.decode(done.stdout, type=_Catalog)


def keep_driver(found: CatalogDriver) -> DriverVersion:
    """Record a driver of this release; the release vouches for it.

    One that a person brought before it was released is from now on of the release.
    """
    fields = _fields(found) | {
        "origin": DriverVersion.Origin.RELEASE,
        "state": _State.APPROVED,
        "proposed_by": None,
        "approved_by": None,
    }
    row = DriverVersion.objects.filter(digest=found.spec.digest).first()
    if row is not None and row.origin == DriverVersion.Origin.RELEASE and row.approval:
        return row
    row, _ = DriverVersion.objects.update_or_create(digest=found.spec.digest, defaults=fields)
    _sign(row)
    return row


def _fields(found: CatalogDriver) -> dict[str, object]:
    spec = found.spec
    return {
        "module": spec.module,
        "class_name": spec.class_name,
        "role": spec.role,
        "spec": msgspec.to_builtins(spec),
        "sources": found.sources,
    }


def read_driver(
    module: str, text: str, *, actor: User
) -> tuple[CatalogDriver, DriverVersion | None]:
    """Read driver source for who may bring drivers; nothing is executed and nothing is written.

    Returns:
        What it declares, and the version of this very source, if it is known.

    Raises:
        ForbiddenError: The actor may not bring drivers.
        ConformanceError: It breaks a rule; `findings` list each place.
        EnrollmentError: The reader failed, or took too long.
    """
    root = resource_selectors.root_of(resource_selectors.the_lab())
    resource_selectors.require(actor, Permission.SUBMIT, [root.id])
    found = inspect_text(module, text)
    return found, DriverVersion.objects.filter(digest=found.spec.digest).first()


@atomic
def propose_driver(found: CatalogDriver, module: str, *, note: str, actor: User) -> DriverVersion:
    """Keep driver source that a person brought, for another person to approve.

    Args:
        found: What `read_driver` returned for the actor. It reads outside of the transaction,
            because another process takes seconds to do it.
        module: Where the driver is to stand.
        note: What the actor says of it.
        actor: Who brings it.

    Raises:
        DefinitionError: With what it shares it is too large.
        StateError: This very source is known already.

    Effect:
        None. No host hears of it before it is approved and a device is to use it.
    """
    if len(encode_bundle(found.sources)) > MAX_BUNDLE_BYTES:
        raise DefinitionError("the driver with what it shares is too large", code="driver.bundle")
    fields = _fields(found) | {
        "origin": DriverVersion.Origin.UPLOAD,
        "state": _State.PROPOSED,
        "note": note,
        "proposed_by": actor,
        "proposed_at": now(),
        "approved_by": None,
        "approved_at": None,
        "approval": {},
    }
    # Whoever writes the row first has proposed it: of two at the same moment the other is refused.
    row, is_new = DriverVersion.objects.select_for_update(no_key=True).get_or_create(
        digest=found.spec.digest, defaults=fields
    )
    if not is_new:
        _propose_again(row, fields)
    detail = {"digest": row.digest, "module": module}
    account_services.write_audit(
        "driver.propose", str(row.id), actor=actor, reason=note, detail=detail
    )
    on_commit(partial(feed.publish, "drivers", {"driver_id": str(row.id)}))
    return row


def _propose_again(row: DriverVersion, fields: Mapping[str, object]) -> None:
    """Write over a version that was rejected or withdrawn; the caller has locked it."""
    if row.state in {_State.PROPOSED, _State.APPROVED}:
        raise StateError(
            f"this source is {row.state} already as {row}",
            code="driver.known",
            context={"id": str(row.id), "state": row.state},
        )
    for name, value in fields.items():
        setattr(row, name, value)
    row.save()


@atomic
def settle_proposal(
    version_id: UUID, *, actor: User, is_approved: bool, comment: str
) -> DriverVersion:
    """Write down what a second person decided; an approval signs the digest.

    The caller has checked the request; this refuses a second time who proposed it.

    Raises:
        NotFoundError: There is no such version.
        StateError: It is not proposed, or its texts are not those of its digest.
        ForbiddenError: The actor proposed it.
    """
    row = selectors.driver_for_update(version_id)
    if row.state != _State.PROPOSED:
        raise StateError(f"{row} is {row.state}", code="driver.not_proposed")
    if row.proposed_by_id == actor.pk:
        raise ForbiddenError("a second person has to answer", code="driver.own")
    if digest_of(row.sources) != row.digest:
        raise StateError(f"the texts of {row} are not those of its digest", code="driver.digest")
    if is_approved:
        row.approved_by, row.approved_at = actor, now()
        row.state = _State.APPROVED
        row.save(update_fields=["approved_by", "approved_at", "state"])
        _sign(row)
    else:
        row.state = _State.REJECTED
        row.save(update_fields=["state"])
    account_services.write_audit(
        "driver.approve" if is_approved else "driver.reject",
        str(row.id),
        actor=actor,
        reason=comment,
        detail={"digest": row.digest},
        meaning="approves the driver" if is_approved else "rejects the driver",
    )
    on_commit(partial(feed.publish, "drivers", {"driver_id": str(row.id)}))
    return row


def _sign(row: DriverVersion) -> None:
    approval = DriverApproval(
        digest=row.digest,
        module=row.module,
        class_name=row.class_name,
        origin=row.origin,
        proposed_by="" if row.proposed_by_id is None else str(row.proposed_by_id),
        approved_by="" if row.approved_by_id is None else str(row.approved_by_id),
        approved_at=now().isoformat(),
    )
    row.approval = msgspec.to_builtins(signing.sign(approval))
    row.save(update_fields=["approval"])


@atomic
def withdraw_driver(version_id: UUID, *, actor: User, reason: str) -> DriverVersion:
    """Let a version be used no more.

    Raises:
        NotFoundError: There is no such version.
        ForbiddenError: The actor may not admit devices.
        DefinitionError: No reason was given.
        StateError: A device uses it, or it is neither proposed nor approved.
    """
    row = selectors.driver_for_update(version_id)
    root = resource_selectors.root_of(resource_selectors.the_lab())
    resource_selectors.require(actor, Permission.ADMIT, [root.id])
    refuse_no_reason(reason, "say why", code="driver.no_reason")
    users = sorted(selectors.users_of_driver(row).values_list("key", flat=True))
    if users:
        text = f"{row} is used by {', '.join(users)}: give them another version first"
        raise StateError(text, code="driver.in_use")
    if row.state not in {_State.PROPOSED, _State.APPROVED}:
        raise StateError(f"{row} is {row.state}", code="driver.not_proposed")
    row.state = _State.WITHDRAWN
    row.approval = {}
    row.save(update_fields=["state", "approval"])
    account_services.write_audit("driver.withdraw", str(row.id), actor=actor, reason=reason)
    on_commit(partial(feed.publish, "drivers", {"driver_id": str(row.id)}))
    return row


def parts_of(host_id: UUID, digest: str) -> list[DriverPart]:
    """Return the pieces of a bundle for a host that serves it, or is to; else why not."""
    row = selectors.driver_for_host(host_id, digest)
    if row is None or not row.approval or not row.sources:
        return [DriverPart(digest=digest, problem="no approved driver of a device of this host")]
    data = encode_bundle(row.sources)
    pieces = [data[at : at + PART_BYTES] for at in range(0, len(data), PART_BYTES)]
    approval = msgspec.convert(row.approval, Signed)
    return [
        DriverPart(
            digest=digest,
            index=index,
            count=len(pieces),
            data=piece,
            approval=approval if index == 0 else None,
        )
        for index, piece in enumerate(pieces)
    ]
