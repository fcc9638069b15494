"""What a person may do in a lab, asked for many resources at once."""

from __future__ import annotations

from collections.abc import Iterable

from labweb.accounts import selectors as account_selectors
from labweb.accounts.selectors import User
from labweb.domain.approvals.role_permissions import Permission
from labweb.resources.models import Lab
from labweb.resources.selectors.labs import the_lab
from labweb.resources.selectors.resource_tree import root_of


def permissions_of(user: User, roles: Iterable[str] | None = None) -> frozenset[Permission]:
    """Return what the user may do anywhere; what they may do to a resource is `require`."""
    return account_selectors.permissions_of(user, roles)


def permissions_on_all(user: User, lab: Lab | None = None) -> frozenset[Permission]:
    """Return what the user may do to all of the lab: drivers belong to no part of it."""
    return account_selectors.permissions_on(user, root_of(lab or the_lab()).id)
