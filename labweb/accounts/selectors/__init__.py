"""Reads of users, grants and the audit trail."""

from __future__ import annotations

from labweb.accounts.models import User
from labweb.accounts.selectors.audit_trail import first_subject
from labweb.accounts.selectors.permissions import (
    GRANTED_ROOTS,
    ROLES,
    Backend,
    anybody_who_may,
    granted_roots,
    granting,
    has_role,
    permissions_of,
    permissions_on,
    roles_of,
)
from labweb.accounts.selectors.users import find_user, printed_names, user_by_id, user_of

__all__ = [
    "GRANTED_ROOTS",
    "ROLES",
    "Backend",
    "User",
    "anybody_who_may",
    "find_user",
    "first_subject",
    "granted_roots",
    "granting",
    "has_role",
    "permissions_of",
    "permissions_on",
    "printed_names",
    "roles_of",
    "user_by_id",
    "user_of",
]
