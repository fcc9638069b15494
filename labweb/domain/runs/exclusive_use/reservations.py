"""Reservations: exclusive use in the near future, in the order of asking, which ends by itself."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from uuid import UUID

from labweb.domain.errors import Finding
from labweb.domain.runs.exclusive_use.action_locks import Lock, LockMode, conflicts

LONGEST = timedelta(hours=24)
MOST = 100
"""Resources of one request."""

LONGEST_REASON = 500


def check_request(*, count: int, lasts: timedelta, reason: str) -> list[Finding]:
    """List what speaks against a request for a reservation, whatever the lab looks like."""
    found = []
    if not 1 <= count <= MOST:
        text = f"{count} resources were asked for; a reservation is for 1 to {MOST}"
        found.append(Finding("reservation.count", text))
    if not timedelta() < lasts <= LONGEST:
        most = LONGEST.total_seconds() / 60
        text = (
            f"{lasts.total_seconds() / 60:.0f} minutes were asked for; a reservation lasts from 1 "
            f"to {most:.0f} minutes, which is {most / 60:.0f} hours"
        )
        found.append(Finding("reservation.length", text))
    if not reason.strip():
        text = "say what the reservation is for: the others read it"
        found.append(Finding("reservation.reason", text))
    elif len(reason) > LONGEST_REASON:
        text = f"the reason has {len(reason)} characters, and may have {LONGEST_REASON}"
        found.append(Finding("reservation.reason", text))
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class ReservedLock:
    """One lock that a reservation which holds now keeps for its holder."""

    lock: Lock
    reservation_id: UUID
    made_at: datetime
    is_own: bool
    """It is the reservation of who asks."""

    @property
    def turn(self) -> tuple[datetime, UUID]:
        """Its place in the line."""
        return self.made_at, self.reservation_id


def in_the_way(wanted: Iterable[Lock], claims: Sequence[ReservedLock]) -> list[UUID]:
    """Return the reservations of others that who asks must wait for, the oldest first.

    Those who came after a reservation of one's own for the same thing are not among them.
    """
    locks = {lock.resource_id: lock for lock in wanted}
    own: dict[UUID, list[ReservedLock]] = {}
    for claim in claims:
        if claim.is_own:
            own.setdefault(claim.lock.resource_id, []).append(claim)
    found = {
        claim.turn
        for claim in claims
        if not claim.is_own
        and claim.lock.resource_id in locks
        and conflicts([locks[claim.lock.resource_id]], [claim.lock])
        and not any(
            mine.turn < claim.turn and _covers(mine.lock, locks[claim.lock.resource_id])
            for mine in own.get(claim.lock.resource_id, ())
        )
    }
    return [reservation_id for _, reservation_id in sorted(found)]


def _covers(own: Lock, wanted: Lock) -> bool:
    return own.mode is LockMode.EXCLUSIVE or own.mode is wanted.mode
