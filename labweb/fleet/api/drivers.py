"""Drivers: what there is, who vouches for it, which device uses it, and what shall."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar
from uuid import UUID

import msgspec
from msgspec.structs import asdict
from rest_framework.request import Request

from labweb.accounts.api import Endpoint
from labweb.accounts.selectors import User, user_of
from labweb.approvals import selectors as approval_selectors
from labweb.approvals import services as approval_services
from labweb.approvals.selectors import ApprovalRequest
from labweb.common.answers import KeyedRef
from labweb.common.clock import now
from labweb.common.lists import STANDING
from labweb.common.requests import body
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.enrollment.driver_source_diff import compare
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.errors import ForbiddenError
from labweb.enrollment import selectors
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import DriverVersion
from labweb.fleet.answers.drivers import (
    ChosenDriver,
    ChosenDriverList,
    DriverComparison,
    DriverDetail,
    DriverList,
    DriverOrigin,
    DriverPartChanges,
    DriverReading,
    DriverRequest,
    DriverRights,
    DriverRow,
    DriverState,
    DriverStatus,
    DriverUse,
    DriverVerdict,
    KnownDriver,
)
from labweb.fleet.api.driver_use import (
    driver_of,
    places_of,
    users_of,
    visible_driver,
    visible_drivers,
)
from labweb.fleet.services import driver_replacement
from labweb.resources import selectors as resource_selectors
from labweb.workflows.api.workflows import device_actions

READS_SOURCE = frozenset({Permission.SUBMIT, Permission.DECIDE, Permission.ADMIT})
"""Who brings, approves or gives drivers reads their source; it may hold what a maker told."""


class Submission(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a driver that a person brings."""

    module: str
    """`drivers.<class>.<model>`."""

    source: str
    note: str = ""


class Text(msgspec.Struct, forbid_unknown_fields=True):
    """Body of source that is to be read, and kept nowhere."""

    module: str
    source: str


class DriverDecision(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a decision about a driver."""

    is_approved: bool
    comment: str = ""


class DriverWithdrawal(msgspec.Struct, forbid_unknown_fields=True):
    """Body of a withdrawal."""

    reason: str


class DriverChoice(msgspec.Struct, forbid_unknown_fields=True):
    """Body that says which version of its driver a device shall have."""

    version_id: UUID
    reason: str
    parts: str = ""
    """The decision about parts that come and go, as they were shown."""


class ChosenDevice(msgspec.Struct, forbid_unknown_fields=True):
    """A device that shall have a version."""

    device_id: UUID
    parts: str = ""
    """The decision about parts that come and go, as they were shown."""


class Choices(msgspec.Struct, forbid_unknown_fields=True):
    """Body that says which devices shall have a version."""

    devices: Annotated[list[ChosenDevice], msgspec.Meta(min_length=1, max_length=200)]
    reason: str


class Drivers(Endpoint):
    """Versions of drivers."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Submission}
    queries = STANDING.parameters
    statuses: ClassVar = {"post": 201}

    def get(self, request: Request) -> DriverList:
        """List every version by module, the newest first, with the devices that use it."""
        user = user_of(request)
        users = users_of(user)
        allowed = resource_selectors.permissions_on_all(user)
        rows = visible_drivers(user, users)
        found, following = STANDING.of_rows(request, rows, "module", "-read_at", "-id")
        return DriverList(
            drivers=[_row(row, user, users, allowed) for row in found], next=following
        )

    def prepare(self, request: Request, *_args: object, **_kwargs: object) -> None:
        """Read the source in its process, before a transaction is open."""
        wanted = body(request, Submission)
        self.found, _ = enrollment_services.read_driver(
            wanted.module, wanted.source, actor=user_of(request)
        )

    def post(self, request: Request) -> DriverRow:
        """Propose driver source that was read; a second person approves it."""
        user, wanted = user_of(request), body(request, Submission)
        row = approval_services.submit_read(self.found, wanted.module, note=wanted.note, actor=user)
        return _row(row, user, {})


class ReadDriver(Endpoint):
    """What driver source declares, before anybody proposes it."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Text}
    harmless: ClassVar[Mapping[str, str]] = {"post": "it reads text and writes nothing"}

    def post(self, request: Request) -> DriverReading:
        """Read source as text; nothing of it is executed, and nothing is written."""
        given = body(request, Text)
        found, known = enrollment_services.read_driver(
            given.module, given.source, actor=user_of(request)
        )
        return DriverReading(
            module=found.spec.module,
            class_name=found.spec.class_name,
            digest=found.spec.digest,
            known=None
            if known is None
            else KnownDriver(id=known.id, state=msgspec.convert(str(known.state), DriverState)),
            **_interface(found.spec),
        )


class OneDriver(Endpoint):
    """One version of a driver."""

    def get(self, request: Request, driver_id: UUID) -> DriverDetail:
        """Return a version with its texts, actions, statuses, settings, request and devices."""
        user = user_of(request)
        row = visible_driver(driver_id, user)
        allowed = resource_selectors.permissions_on_all(user)
        asked = approval_selectors.newest_about_driver(row.id)
        told = asdict(_row(row, user, users_of(user), allowed))
        return DriverDetail(
            **(told | _interface(msgspec.convert(row.spec, DriverSpec))),
            sources=row.sources if READS_SOURCE & allowed else {},
            request=None if asked is None else _request(asked),
            places=places_of(row, user),
            tried=approval_selectors.tried_of(row),
        )


class DriverChanges(Endpoint):
    """What differs between two versions."""

    def get(self, request: Request, driver_id: UUID, since_id: UUID) -> DriverComparison:
        """Compare the texts of a version with those of another, line by line.

        Raises:
            ForbiddenError: The caller may not read source.
        """
        user = user_of(request)
        after, before = (visible_driver(one, user) for one in (driver_id, since_id))
        if not READS_SOURCE & resource_selectors.permissions_on_all(user):
            raise ForbiddenError(f"{user.username} may not read the source of drivers")
        return DriverComparison(modules=compare(before.sources, after.sources))


class DecideDriver(Endpoint):
    """The answer of a second person."""

    signs = frozenset({"post"})
    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": DriverDecision}

    def post(self, request: Request, driver_id: UUID) -> DriverRow:
        """Approve or reject a version."""
        user, answer = user_of(request), body(request, DriverDecision)
        visible_driver(driver_id, user)
        row = approval_services.decide_driver(
            driver_id, actor=user, is_approved=answer.is_approved, comment=answer.comment
        )
        return _row(row, user, users_of(user))


class WithdrawDriver(Endpoint):
    """The end of a version."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": DriverWithdrawal}

    def post(self, request: Request, driver_id: UUID) -> DriverRow:
        """Let a version be used no more."""
        user, reason = user_of(request), body(request, DriverWithdrawal).reason
        visible_driver(driver_id, user)
        row = approval_services.withdraw_driver(driver_id, actor=user, reason=reason)
        return _row(row, user, {})


class DeviceDriver(Endpoint):
    """The version of its driver that a device has, and is to have."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": DriverChoice}

    def post(self, request: Request, device_id: UUID) -> DriverUse:
        """Give a device another version; an earlier one rolls back."""
        user, choice = user_of(request), body(request, DriverChoice)
        selectors.visible_device(device_id, user)
        visible_driver(choice.version_id, user)
        device = driver_replacement.replace_driver(
            device_id,
            choice.version_id,
            actor=user,
            reason=choice.reason,
            parts=choice.parts,
        )
        return driver_of(device)


class DriverDevices(Endpoint):
    """The devices that shall have a version."""

    bodies: ClassVar[dict[str, type[msgspec.Struct]]] = {"post": Choices}

    def post(self, request: Request, approved_id: UUID) -> ChosenDriverList:
        """Give a version to several devices: to all of them, or to none."""
        user, wanted = user_of(request), body(request, Choices)
        visible_driver(approved_id, user)
        for one in wanted.devices:
            selectors.visible_device(one.device_id, user)
        devices = driver_replacement.replace_drivers(
            approved_id,
            [driver_replacement.GivenDriver(one.device_id, one.parts) for one in wanted.devices],
            actor=user,
            reason=wanted.reason,
        )
        return ChosenDriverList(
            devices=[ChosenDriver(id=one.id, driver=driver_of(one)) for one in devices]
        )


class DeviceDriverParts(Endpoint):
    """What another version of its driver makes of a device's parts."""

    def get(self, request: Request, device_id: UUID, approved_id: UUID) -> DriverPartChanges:
        """List the parts that come, go and change, and what speaks against it; for a decision."""
        user = user_of(request)
        row = selectors.visible_device(device_id, user)
        visible_driver(approved_id, user)
        resource_selectors.require(user, Permission.ADMIT, selectors.node_ids(row))
        seen = driver_replacement.look_at_parts(device_id, approved_id)
        return DriverPartChanges(
            decision=seen.decision, changes=list(seen.changes), findings=list(seen.findings)
        )


def _interface(spec: DriverSpec) -> dict[str, Any]:
    """Return the fields that say what a driver declares; a reading and a version have them."""
    return {
        "roles": list(spec.roles),
        "doc": spec.doc,
        "quality": spec.quality,
        "imports": list(spec.imports),
        "protocol": spec.protocol,
        "safe_state": spec.safe_state,
        "actions": device_actions(spec),
        "statuses": [
            DriverStatus(
                name=status.name,
                label=status.value.label or status.name,
                doc=status.doc,
                unit=status.value.symbol,
            )
            for status in spec.statuses
        ],
        "config": spec.config_schema(),
    }


def _request(row: ApprovalRequest) -> DriverRequest:
    decision = getattr(row, "decision", None)
    is_late = row.expires_at <= now()
    is_open = row.state == ApprovalRequest.State.OPEN
    return DriverRequest(
        id=row.id,
        state=ApprovalRequest.State.EXPIRED.value if is_open and is_late else row.state,
        asked_at=row.asked_at,
        expires_at=row.expires_at,
        decision=None
        if decision is None
        else DriverVerdict(
            is_approved=decision.is_approved,
            printed_name=decision.printed_name,
            comment=decision.comment,
            at=decision.at,
        ),
    )


def _row(
    row: DriverVersion,
    user: User,
    users: dict[UUID, list[KeyedRef]],
    allowed: frozenset[Permission] | None = None,
) -> DriverRow:
    if allowed is None:
        allowed = resource_selectors.permissions_on_all(user)
    is_open = row.state == DriverVersion.State.PROPOSED
    return DriverRow(
        id=row.id,
        module=row.module,
        class_name=row.class_name,
        role=row.role,
        digest=row.digest,
        origin=msgspec.convert(str(row.origin), DriverOrigin),
        state=msgspec.convert(str(row.state), DriverState),
        note=row.note,
        quality=row.spec.get("quality", ""),
        doc=row.spec.get("doc", ""),
        proposed_by=None if row.proposed_by is None else row.proposed_by.printed_name,
        proposed_at=row.proposed_at,
        approved_by=None if row.approved_by is None else row.approved_by.printed_name,
        approved_at=row.approved_at,
        read_at=row.read_at,
        devices=users.get(row.id, []),
        can=DriverRights(
            read=bool(READS_SOURCE & allowed),
            decide=is_open and Permission.DECIDE in allowed and row.proposed_by_id != user.pk,
            withdraw=Permission.ADMIT in allowed
            and row.state in {DriverVersion.State.PROPOSED, DriverVersion.State.APPROVED},
        ),
    )
