"""Reads of labs."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from django.db.models import QuerySet, UUIDField

from labweb.accounts import selectors as account_selectors
from labweb.common.database.prepared_queries import Given, Prepared
from labweb.domain.errors import NotFoundError
from labweb.resources.models import Lab

_MOST_LABS = 1000


def the_lab() -> Lab:
    """Return the lab this server runs: the only one, and of several the first imported.

    A second lab is refused; a database from before that rule may hold one, and the lab that
    ran first must stay the one that a stop is for.

    Raises:
        NotFoundError: None was imported yet.
    """
    labs = {str(lab.id): lab for lab in Lab.objects.order_by("id")[:_MOST_LABS]}
    if not labs:
        raise NotFoundError("no lab yet: import one with import_lab", code="lab.none")
    first = next(iter(labs))
    if len(labs) > 1:
        first = account_selectors.first_subject("lab.import", labs) or first
    return labs[first]


def lab_for_update(lab_id: UUID) -> Lab:
    """Lock and return a lab.

    Raises:
        NotFoundError: There is none.
    """
    return locked(LAB_TO_LOCK.rows(id=lab_id), lab_id)


def locked(rows: Sequence[Lab], lab_id: UUID) -> Lab:
    """Return the lab that `LAB_TO_LOCK` has found; raises as above."""
    if not rows:
        raise NotFoundError(f"no lab {lab_id}", code="lab.none")
    return rows[0]


LAB_TO_LOCK = Prepared(
    lambda: Lab.objects.filter(pk=Given("id", UUIDField())).select_for_update(
        of=("self",), no_key=True
    )
)


def labs() -> QuerySet[Lab]:
    """All labs."""
    return Lab.objects.all()
