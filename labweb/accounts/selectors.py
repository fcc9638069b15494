"""Reads of users, grants and the audit trail."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from uuid import UUID

from django.contrib.auth.backends import ModelBackend
from django.db.models import UUIDField
from rest_framework.request import Request

from labweb.accounts.models import AuditEntry, Grant
from labweb.accounts.models import User as User
from labweb.common.prepared import Given, Prepared
from labweb.domain.approvals.roles import PERMISSIONS, Permission, roles_with
from labweb.domain.errors import ForbiddenError


class Backend(ModelBackend):
    """Signs in with name and password, and reads who is signed in with a prepared statement."""

    def get_user(self, user_id: UUID) -> User | None:
        """Return an active user, or None."""
        user = _USER.first(id=user_id)
        return user if user is not None and self.user_can_authenticate(user) else None


_USER = Prepared(lambda: User.objects.filter(pk=Given("id", UUIDField())))


def granted_roots(user: User, permission: Permission) -> set[UUID]:
    """Return the resources whose whole subtree the user has the permission on."""
    if not user.is_active:
        return set()
    return {resource_id for (resource_id,) in _roots(permission).rows(user=user.pk)}


@cache
def _roots(permission: Permission) -> Prepared[tuple[UUID]]:
    rows = Grant.objects.filter(user_id=Given("user", UUIDField()), role__in=roles_with(permission))
    return Prepared(lambda: rows.values_list("resource_id"))


def roles_of(user: User) -> list[str]:
    """Return the user's roles, anywhere."""
    return sorted({role for (role,) in _ROLES.rows(user=user.pk)})


_ROLES = Prepared(
    lambda: Grant.objects.filter(user_id=Given("user", UUIDField())).values_list("role")
)


def permissions_of(user: User) -> frozenset[Permission]:
    """Return everything the user's roles carry, anywhere."""
    granted = [PERMISSIONS[role] for role in roles_of(user) if role in PERMISSIONS]
    return frozenset().union(*granted)


def user_by_id(user_id: UUID) -> User | None:
    """Return the user with that id."""
    return User.objects.filter(pk=user_id).first()


def printed_names(ids: Iterable[str]) -> dict[str, str]:
    """Return the name that stands under a decision, by id; one query."""
    rows = User.objects.filter(pk__in=list(ids))
    return {str(row.pk): row.printed_name for row in rows}


def first_subject(action: str, subjects: Iterable[str]) -> str | None:
    """Return which of the subjects had this done to it first, by the audit trail."""
    rows = AuditEntry.objects.filter(action=action, subject__in=list(subjects)).order_by("id")
    return rows.values_list("subject", flat=True).first()


def find_user(username: str) -> User | None:
    """Return the user of that name."""
    return User.objects.filter(username=username).first()


def user_of(request: Request) -> User:
    """Return who is signed in.

    Raises:
        ForbiddenError: Nobody is.
    """
    if not isinstance(request.user, User):
        raise ForbiddenError("sign in first", code="http.not_authenticated")
    return request.user
