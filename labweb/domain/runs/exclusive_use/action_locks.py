"""Which locks an action needs: the whole set at once, in one order."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from uuid import UUID


class LockMode(StrEnum):
    """Multi-granularity: X on a node needs IX on all above it."""

    EXCLUSIVE = "X"
    INTENTION = "IX"


@dataclass(frozen=True, slots=True, order=True)
class Lock:
    """One lock to take."""

    resource_id: UUID
    mode: LockMode


def lock_set(
    targets: Iterable[UUID],
    ancestors: Mapping[UUID, Sequence[UUID]],
    roomy: Collection[UUID] = (),
) -> tuple[Lock, ...]:
    """Return the closed set for exclusive use of the targets, in id order.

    Args:
        targets: Resources an action uses: devices, vessels, the route.
        ancestors: Everything above each target.
        roomy: Those of the targets that something is only put into or taken from, beside
            others that stay there undisturbed: a room, a bench. An intention is enough.
    """
    used = set(targets)
    exclusive = used.difference(roomy)
    above = {node for target in used for node in ancestors.get(target, ())}
    modes = dict.fromkeys(above | used, LockMode.INTENTION)
    modes.update(dict.fromkeys(exclusive, LockMode.EXCLUSIVE))
    return tuple(sorted(Lock(node, mode) for node, mode in modes.items()))


def conflicts(wanted: Iterable[Lock], held: Iterable[Lock]) -> list[UUID]:
    """Return the resources whose held lock excludes the wanted one, in id order.

    X excludes everything; two intentions live side by side.
    """
    modes: dict[UUID, set[LockMode]] = {}
    for lock in held:
        modes.setdefault(lock.resource_id, set()).add(lock.mode)
    blocked = []
    for lock in wanted:
        there = modes.get(lock.resource_id, set())
        if LockMode.EXCLUSIVE in there or (there and lock.mode is LockMode.EXCLUSIVE):
            blocked.append(lock.resource_id)
    return sorted(blocked)
