"""Take the parts of a device that is retired out of the tree, empty, through the one write path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from uuid import UUID

import msgspec
from django.db.transaction import atomic

from labweb.crutd.selectors import snapshot
from labweb.crutd.selectors.device_parts import own_parts
from labweb.crutd.selectors.reservations import reservations_on
from labweb.crutd.services.events import wait_for_others
from labweb.crutd.services.locks import hold
from labweb.crutd.services.transactions import carry_out, check_operation
from labweb.domain.crutd.operations import Delete, Refit
from labweb.domain.errors import Finding
from labweb.enrollment.selectors import Device
from labweb.resources import selectors as resource_selectors


@dataclass(frozen=True, slots=True)
class Leaving:
    """What leaves the tree with a device, locked, and what it acted through that stays."""

    device: Device
    parts: tuple[UUID, ...]
    """Each with all that stands in it."""

    within: frozenset[UUID]
    """The parts and all that stands in them."""

    staying: frozenset[UUID]
    """Not its own: a flask that it heated, or what another device acts through too."""

    archive_id: UUID | None


@atomic
def hold_leaving(device: Device) -> Leaving:
    """Lock what leaves the tree with a device, until the end of the caller's block.

    A part is its own where its driver brings one of this kind for the role that is bound
    there, and no other device acts through it.

    Raises:
        LockedError: Somebody uses one of them just now.
    """
    wait_for_others(device.lab)
    parts = own_parts(device)
    within = resource_selectors.descendants(parts) if parts else set()
    archive = resource_selectors.archive_of(device.lab)
    bound = {UUID(node) for node in device.nodes.values()}
    if held := within | bound:
        hold(held)
    return Leaving(
        device=device,
        parts=tuple(sorted(parts)),
        within=frozenset(within),
        staying=frozenset(bound - within),
        archive_id=None if archive is None else archive.id,
    )


def check_leaving(leaving: Leaving) -> list[Finding]:
    """List what speaks against it: matter, tubes, doubts, reservations, what stands in a part."""
    return [*_check_parts(leaving), *_check_staying(leaving)]


def _check_parts(leaving: Leaving) -> list[Finding]:
    """Ask as for parts that go with a version: the same must hold of them."""
    if not leaving.parts:
        return []
    device = leaving.device
    question = Refit(
        device_id=device.id,
        anchor_id=leaving.parts[0],
        digest=device.driver.digest,
        gone=leaving.parts,
        archive_id=leaving.archive_id or msgspec.UNSET,
    )
    found: dict[tuple[str, str], Finding] = {}
    for one in check_operation(question, lab=device.lab, actor_id=None):
        found.setdefault((one.code, one.subject), one)
    inside = resource_selectors.rows(leaving.within.difference(leaving.parts))
    for state in snapshot(inside).values():
        if state.quarantined_by is not None:
            found[("crutd.quarantined", str(state.id))] = _quarantined(state.id, state.name)
    return list(found.values())


def _check_staying(leaving: Leaving) -> Iterator[Finding]:
    for row in resource_selectors.rows(leaving.staying):
        if row.quarantined_by is not None:
            yield _quarantined(row.id, row.name)
    for one in reservations_on(leaving.device.lab, leaving.staying):
        text = f"{one.resource.name} is reserved by {one.holder.printed_name}: {one.reason}"
        yield Finding("crutd.reserved", text, str(one.resource_id))


def _quarantined(resource_id: UUID, name: str) -> Finding:
    text = f"{name} is quarantined: a person has to say what happened first"
    return Finding("crutd.quarantined", text, str(resource_id))


def take_out(leaving: Leaving, *, actor_id: UUID, note: str) -> None:
    """Take what was held, and found free of all this, to the Archive.

    Raises:
        PreconditionError: The tree does not let one go; the caller's block takes all back.

    Effect:
        None on matter. Each part is deleted as by hand, and comes back by a restore.
    """
    for part in leaving.parts:
        if leaving.archive_id is None:
            raise ValueError("parts leave, and the lab has no Archive: check first")
        operation = Delete(resource_id=part, archive_id=leaving.archive_id)
        carry_out(operation, lab=leaving.device.lab, actor_id=actor_id, note=note)
