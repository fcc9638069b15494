"""What a person may do in a lab, asked for many resources at once."""

from __future__ import annotations

from collections.abc import Iterable

from labweb.accounts import selectors as account_selectors
from labweb.accounts.selectors import User
from labweb.domain.approvals.role_permissions import Permission
from labweb.resources.models import Connection as Connection
from labweb.resources.models import Lab as Lab
from labweb.resources.models import Lot as Lot
from labweb.resources.models import Material as Material
from labweb.resources.models import Resource as Resource
from labweb.resources.selectors.access import Reach as Reach
from labweb.resources.selectors.access import allowed_ids as allowed_ids
from labweb.resources.selectors.access import allowed_of as allowed_of
from labweb.resources.selectors.access import asking_allowed as asking_allowed
from labweb.resources.selectors.access import reach_of as reach_of
from labweb.resources.selectors.access import require as require
from labweb.resources.selectors.access import require_seen as require_seen
from labweb.resources.selectors.ancestry import Above as Above
from labweb.resources.selectors.ancestry import ancestors as ancestors
from labweb.resources.selectors.ancestry import ancestors_and_archived as ancestors_and_archived
from labweb.resources.selectors.ancestry import asking_hold as asking_hold
from labweb.resources.selectors.ancestry import descendants as descendants
from labweb.resources.selectors.ancestry import held_of as held_of
from labweb.resources.selectors.ancestry import hold as hold
from labweb.resources.selectors.labs import the_lab
from labweb.resources.selectors.resource_tree import root_of


def permissions_of(user: User, roles: Iterable[str] | None = None) -> frozenset[Permission]:
    """Return what the user may do anywhere; what they may do to a resource is `require`."""
    return account_selectors.permissions_of(user, roles)


def permissions_on_all(user: User, lab: Lab | None = None) -> frozenset[Permission]:
    """Return what the user may do to all of the lab: drivers belong to no part of it."""
    return account_selectors.permissions_on(user, root_of(lab or the_lab()).id)
