"""Which permissions a person has, and where."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

from django.contrib.auth.backends import ModelBackend
from django.db.models import Exists, OuterRef, UUIDField

from labweb.accounts.models import Grant, User
from labweb.common.database.prepared_queries import Given, Prepared, Question, together
from labweb.domain.approvals.role_permissions import PERMISSIONS, Permission, roles_with


class Backend(ModelBackend):
    """Signs in with name and password, and reads who is signed in with a prepared statement."""

    def get_user(self, user_id: UUID) -> User | None:
        """Return an active user, or None."""
        user = _USER.first(id=user_id)
        return user if user is not None and self.user_can_authenticate(user) else None


_USER = Prepared(
    lambda: User.objects.filter(pk=Given("id", UUIDField())).annotate(
        has_role=Exists(Grant.objects.filter(user=OuterRef("pk")))
    )
)


GRANTED_ROOTS = """
SELECT resource_id FROM accounts_grant WHERE user_id = %s AND role = ANY(%s)
"""
"""The resources whose whole subtree a user has a permission on, for a query that goes on from
there."""


def granted_roots(user: User, permission: Permission) -> set[UUID]:
    """Return these for a user."""
    (found,) = together(Question(GRANTED_ROOTS, granting(user, permission), tuple))
    return {resource_id for (resource_id,) in found}


def granting(user: User, permission: Permission) -> tuple[UUID, list[str]]:
    """Return the values for that query; nobody who may not sign in is granted anything."""
    return user.pk, roles_with(permission) if user.is_active else []


def has_role(user: User) -> bool:
    """Say whether a person was granted any role, anywhere; whoever is signed in was asked."""
    known = getattr(user, "has_role", None)
    return bool(roles_of(user)) if known is None else bool(known)


def roles_of(user: User) -> list[str]:
    """Return the user's roles, anywhere."""
    return sorted({role for (role,) in ROLES.rows(user=user.pk)})


ROLES = Prepared(
    lambda: Grant.objects.filter(user_id=Given("user", UUIDField())).values_list("role")
)
"""The roles of a user, each as often as it was granted."""


def permissions_of(user: User, roles: Iterable[str] | None = None) -> frozenset[Permission]:
    """Return everything the user's roles carry, anywhere; the roles, if they were read."""
    known = roles_of(user) if roles is None else roles
    granted = [PERMISSIONS[role] for role in known if role in PERMISSIONS]
    return frozenset().union(*granted)


def permissions_on(user: User, resource_id: UUID) -> frozenset[Permission]:
    """Return everything that roles granted on this very resource carry; of a root, all there is."""
    if not user.is_active:
        return frozenset()
    roles = Grant.objects.filter(user_id=user.pk, resource_id=resource_id)
    granted = [PERMISSIONS[role] for role in roles.values_list("role", flat=True)]
    return frozenset().union(*granted)


def anybody_who_may(permission: Permission) -> User | None:
    """Return the first active user who was granted that anywhere, or None."""
    rows = Grant.objects.filter(role__in=roles_with(permission), user__is_active=True)
    grant = rows.select_related("user").order_by("pk").first()
    return None if grant is None else grant.user
