"""How far a person reaches into the tree: what they may see, and where they may act."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from uuid import UUID

from labweb.accounts import selectors as account_selectors
from labweb.accounts.selectors import User
from labweb.common.database.prepared_queries import Question, together
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import ForbiddenError, NotFoundError
from labweb.resources.selectors.ancestry import Below


def allowed_ids(user: User, permission: Permission) -> set[UUID]:
    """Return every resource on which the user has the permission; one query, or two."""
    (found,) = together(asking_allowed(user, permission))
    return allowed_of(found, user, permission)


_GRANTED = Below(account_selectors.GRANTED_ROOTS)


def asking_allowed(user: User, permission: Permission) -> Question[UUID]:
    """Return what finds those resources, as far as they are few."""
    return _GRANTED.asking(account_selectors.granting(user, permission))


def allowed_of(found: list[UUID], user: User, permission: Permission) -> set[UUID]:
    """Return them all, when that has found these; one query more when they are many."""
    return _GRANTED.all_of(found, account_selectors.granting(user, permission))


@dataclass(frozen=True, slots=True)
class Reach:
    """Where a user has a permission, read once."""

    user: User
    permission: Permission
    ids: Collection[UUID]
    """Every resource on which they have it."""

    def require(self, ids: Iterable[UUID]) -> None:
        """Refuse unless the user has the permission on every one of the resources.

        Raises:
            ForbiddenError: They lack it, there or everywhere; nothing changed.
        """
        missing = set(ids).difference(self.ids)
        if missing or not self.ids:
            named = {"permission": self.permission.value, "resources": sorted(map(str, missing))}
            text = f"{self.user.username} may not {self.permission.value} here"
            raise ForbiddenError(text, context=named)


def reach_of(user: User, permission: Permission) -> Reach:
    """Return where the user has the permission; one query, or two."""
    return Reach(user, permission, allowed_ids(user, permission))


def require(user: User, permission: Permission, ids: Iterable[UUID]) -> None:
    """Refuse as `Reach.require`, for a single question; one query, or two.

    Raises:
        ForbiddenError: They lack it; nothing changed.
    """
    reach_of(user, permission).require(ids)


def require_seen(user: User, ids: Iterable[UUID]) -> None:
    """Refuse unless the user may see every one of the resources.

    Raises:
        NotFoundError: There is none, or they may not know of it.
    """
    seen = allowed_ids(user, Permission.VIEW)
    for one in ids:
        if one not in seen:
            raise NotFoundError(f"no resource {one}", code="resource.not_found")
