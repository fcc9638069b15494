"""Give a device the parts that another version of its driver has, in one transaction."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any
from uuid import UUID, uuid5

import msgspec
from django.db.transaction import atomic

from labweb.crutd.services.transactions import carry_out, check_operation
from labweb.domain.crutd.operations import Create, Joint, Refit
from labweb.domain.enrollment.driver_spec import DriverSpec
from labweb.domain.errors import Finding, PreconditionError
from labweb.domain.graph.device_parts import DeviceComponent, InnerTube
from labweb.domain.graph.device_parts_changes import PartChanges, find_changes
from labweb.domain.graph.ports_and_connections import Medium
from labweb.domain.resources.resource_kinds import is_vessel
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.selectors import Device, DriverVersion
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Connection, Resource


@dataclass(frozen=True, slots=True, kw_only=True)
class RefitWish:
    """An operation, and through what the device acts once it is done."""

    operation: Refit
    nodes: Mapping[str, UUID]
    gone: Mapping[str, UUID]
    """Roles that fall away, by the part that goes with them; it may come back."""


def check_parts(device: Device, version: DriverVersion) -> tuple[list[Finding], set[UUID]]:
    """List what speaks against the parts of another version now, and return the parts that go."""
    try:
        wish = _wish(device, version)
    except PreconditionError as error:
        return list(error.findings), set()
    if wish is None:
        return [], set()
    gone = resource_selectors.descendants(wish.operation.gone) if wish.operation.gone else set()
    return check_operation(wish.operation, lab=device.lab, actor_id=None), gone


@atomic
def refit_device(device: Device, version: DriverVersion, *, actor_id: UUID, note: str) -> None:
    """Let parts come, go and change as a version of the driver has them; the caller gives it.

    Raises:
        LockedError: Somebody uses a part just now. Nothing was written.
        PreconditionError: A part that goes holds matter, is connected, reserved, or has
            something standing in it; or what comes does not fit. Nothing was written.

    Effect:
        None on matter. What goes is in the Archive, what comes is empty and of unknown pose.
    """
    wish = _wish(device, version)
    if wish is None:
        return
    carry_out(wish.operation, lab=device.lab, actor_id=actor_id, note=note)
    enrollment_services.give_parts(device, wish.nodes, past=wish.gone)


def _wish(device: Device, version: DriverVersion) -> RefitWish | None:
    old, new = (msgspec.convert(one.spec, DriverSpec) for one in (device.driver, version))
    changes = find_changes(old, new, device.config, key=device.key, name=device.name)
    if not device.nodes or not changes:
        return None
    return _Fitting(device, version, changes).wish()


class _Fitting:
    """From parts as drivers tell of them to resources as the lab has them."""

    def __init__(self, device: Device, version: DriverVersion, changes: PartChanges) -> None:
        self.device = device
        self.version = version
        self.changes = changes
        before = changes.before.parts
        own = {part.key: self._own(part) for part in before}
        found = resource_selectors.rows([one for one in own.values() if one is not None])
        rows = {row.id: row for row in found.filter(lab=device.lab)}
        self.rows = {key: rows[one] for key, one in own.items() if one in rows}
        """Resource by the key before, of those parts that stand in the tree."""

        self.ids = {key: self.rows[was].id for key, was in changes.kept.items() if was in self.rows}
        """Resource by the key after."""

    def _own(self, part: DeviceComponent) -> UUID | None:
        for role in part.roles:
            if role in self.device.nodes:
                return UUID(self.device.nodes[role])
        return uuid5(self.device.id, part.key) if part.inside else None

    def wish(self) -> RefitWish:
        """Return the operation.

        Raises:
            PreconditionError: A part cannot be found in the tree, or cannot come.
        """
        changes, lab = self.changes, self.device.lab
        self._check_known()
        anchor = next(iter(self.rows.values()))
        added, back = self._arriving(anchor)
        tops = [self.rows[part.key].id for part in self._tops() if part.key in self.rows]
        gone = tuple(one for one in tops if not self._is_shared(one))
        archive = resource_selectors.archive_of(lab) if gone or back else None
        operation = Refit(
            device_id=self.device.id,
            anchor_id=anchor.id,
            digest=self.version.digest,
            added=tuple(added),
            back=back,
            gone=gone,
            archive_id=msgspec.UNSET if archive is None else archive.id,
            configs=dict(self._configs()),
            joined=tuple(self._joined()),
            parted=tuple(sorted(self._parted())),
        )
        nodes = {
            role: self.ids[part.key]
            for part in changes.after.parts
            for role in part.roles
            if part.key in self.ids
        }
        past = {
            role: self.rows[part.key].id
            for part in changes.lost
            for role in part.roles
            if part.key in self.rows
        }
        return RefitWish(operation=operation, nodes=nodes, gone=past)

    def _check_known(self) -> None:
        """Refuse where the device cannot tell its own parts from what others drew."""
        places = [part for part in (*self.changes.lost, *self.changes.gained) if part.inside]
        unknown = [
            part for part in self.changes.before.parts if part.inside and part.key not in self.rows
        ]
        if (places and unknown) or not self.rows:
            text = (
                f"the places of {self.device.name} did not come with it, so which of them are "
                "meant is not known: retire the device, and take it up anew with this version"
            )
            found = Finding("driver.parts_unknown", text, self.device.key)
            raise PreconditionError(text, code="driver.parts_unknown", findings=[found])

    def _tops(self) -> list[DeviceComponent]:
        """Return the parts that go, without places that go along inside another.

        A vessel of its own is named beside that which it is in: it must be empty.
        """
        lost = {part.key for part in self.changes.lost}
        return [
            part for part in self.changes.lost if part.inside not in lost or is_vessel(part.kind)
        ]

    def _is_shared(self, resource_id: UUID) -> bool:
        """Say whether the device goes on acting through a resource in another role."""
        return resource_id in self.ids.values()

    def _arriving(self, anchor: Resource) -> tuple[list[Create], dict[UUID, UUID]]:
        added, back = [], {}
        for part in self.changes.gained:
            if part.inside and part.inside not in self.ids:
                continue
            parent = self.ids[part.inside] if part.inside else anchor.parent_id
            if parent is None:
                raise _root(anchor)
            known = self._known_before(part)
            if known is not None:
                self.ids[part.key] = known.id
                if known.is_archived:
                    back[known.id] = parent
                continue
            key = part.key if not self._is_named(part.key) else f"{self.device.key}_{part.kind}"
            self.ids[part.key] = uuid5(self.device.id, key)
            create = Create(
                resource_id=self.ids[part.key],
                parent_id=parent,
                key=key,
                name=part.name,
                kind=part.kind,
                config=dict(part.config),
            )
            added.append(create)
        return added, back

    def _known_before(self, part: DeviceComponent) -> Resource | None:
        """Return the part that the device had before in this role; it is out of service now."""
        past = [self.device.past_nodes.get(role) for role in part.roles]
        ids = [UUID(one) for one in past if one] or [uuid5(self.device.id, part.key)]
        rows = resource_selectors.rows(ids).filter(lab=self.device.lab, kind=part.kind)
        return rows.first()

    def _is_named(self, key: str) -> bool:
        return bool(resource_selectors.taken_keys(self.device.lab, [key]))

    def _configs(self) -> Iterable[tuple[UUID, dict[str, Any]]]:
        """Yield what parts are configured with from now on; what a person added stays."""
        turned = [(was, to, self.rows.get(was.key)) for was, to in self.changes.changed]
        for was, to, row in turned:
            if row is not None and dict(was.config) != dict(to.config):
                yield row.id, _merged(row.config, was.config, to.config)
        for part in self.changes.gained:
            known = self._known_before(part)
            if known is not None and not part.config.items() <= known.config.items():
                yield known.id, {**known.config, **part.config}

    def _joined(self) -> Iterable[Joint]:
        for tube in self.changes.joined:
            if tube.source in self.ids and tube.target in self.ids:
                yield _joint(tube, self.ids)

    def _parted(self) -> Iterable[UUID]:
        for tube in self.changes.parted:
            if tube.source in self.rows and tube.target in self.rows:
                ends = (self.rows[tube.source].id, self.rows[tube.target].id)
                for row in resource_selectors.between(*ends):
                    if _is_this(row, tube, ends):
                        yield row.id


def _merged(
    there: Mapping[str, Any], was: Mapping[str, Any], to: Mapping[str, Any]
) -> dict[str, Any]:
    return {name: value for name, value in there.items() if name not in was} | dict(to)


def _root(anchor: Resource) -> PreconditionError:
    text = f"{anchor.name} is the root of the lab: nothing stands beside it"
    return PreconditionError(
        text, code="crutd.root", findings=[Finding("crutd.root", text, str(anchor.id))]
    )


def _is_this(row: Connection, tube: InnerTube, ends: tuple[UUID, UUID]) -> bool:
    forth = (row.source_id, row.source_port, row.target_id, row.target_port)
    back = (row.target_id, row.target_port, row.source_id, row.source_port)
    return (ends[0], tube.source_port, ends[1], tube.target_port) in (forth, back)


def _joint(tube: InnerTube, ids: Mapping[str, UUID]) -> Joint:
    key = f"{tube.source}_{tube.target}"
    return Joint(
        id=uuid5(ids[tube.source], key),
        key=key,
        source_id=ids[tube.source],
        source_port=tube.source_port,
        target_id=ids[tube.target],
        target_port=tube.target_port,
        medium=Medium.LIQUID.value,
    )
