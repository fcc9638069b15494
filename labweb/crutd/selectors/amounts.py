"""What vessels hold, by lot, from the ledger."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any
from uuid import UUID

from django.db.models import Q, Sum

from labweb.common.database.prepared_queries import (
    Question,
    together,
)
from labweb.crutd.models import Entry, Holding
from labweb.domain.crutd.ledger import Amount
from labweb.domain.crutd.provenance.ledger_flows import is_nominal
from labweb.domain.resources.contents_by_lot import LotId
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab, Lot

_AMOUNTS = """
SELECT resource_id, lot_id, amount_nl, amount_ug FROM crutd_holding
WHERE resource_id = ANY(%s) AND (amount_nl <> 0 OR amount_ug <> 0)
"""


_AMOUNTS_OF_LAB = """
SELECT resource_id, lot_id, amount_nl, amount_ug FROM crutd_holding
JOIN resources_resource ON resources_resource.id = resource_id
WHERE lab_id = %s AND (amount_nl <> 0 OR amount_ug <> 0)
"""


def contents(ids: Iterable[UUID]) -> dict[UUID, dict[LotId, int]]:
    """Return nanolitres by lot of each vessel; empty ones are missing."""
    found: dict[UUID, dict[LotId, int]] = {}
    for resource_id, held in amounts(ids).items():
        liquids = {lot: amount.nl for lot, amount in held.items() if amount.nl}
        if liquids:
            found[resource_id] = liquids
    return found


def amounts(ids: Iterable[UUID]) -> dict[UUID, dict[LotId, Amount]]:
    """Return what each vessel holds by lot, whatever it is counted in; empty ones are missing."""
    (rows,) = together(Question(_AMOUNTS, [list(ids)], tuple))
    return amounts_by_vessel(rows)


def asking_amounts(lab_id: UUID) -> Question[tuple[Any, ...]]:
    """Return what finds all that a lab's vessels hold, for `lab_snapshot`."""
    return Question(_AMOUNTS_OF_LAB, [lab_id], tuple)


def amounts_by_vessel(rows: Iterable[tuple[Any, ...]]) -> dict[UUID, dict[LotId, Amount]]:
    """Sort rows of vessel, lot, nanolitres and micrograms by vessel."""
    found: dict[UUID, dict[LotId, Amount]] = {}
    for resource_id, lot_id, nl, ug in rows:
        found.setdefault(resource_id, {})[LotId(str(lot_id))] = Amount(nl, ug)
    return found


def balance_by_lot(lab: Lab) -> dict[UUID, int]:
    """Return, by lot, credits minus debits over all accounts; zero when nothing was lost."""
    posted = Entry.objects.filter(state=Entry.State.POSTED, transaction__lab=lab)
    held = (
        Holding.objects.filter(resource__lab=lab).values("lot_id").annotate(total=Sum("amount_nl"))
    )
    sums = {row["lot_id"]: row["total"] for row in held}
    for lot_id, debit, credit, amount in posted.values_list(
        "lot_id", "debit", "credit", "amount_nl"
    ):
        if lot_id is None:
            continue
        for account, sign in ((debit, 1), (credit, -1)):
            if not is_nominal(account):
                sums[lot_id] = sums.get(lot_id, 0) + sign * amount
    return sums


def visible_lots(lab: Lab, seen: Collection[UUID]) -> list[Lot]:
    """Return the lots that one of the resources holds; all to who sees the root."""
    lots = resource_selectors.lots_of(lab)
    if resource_selectors.root_of(lab).id in seen:
        return list(lots)
    some = Q(amount_nl__gt=0) | Q(amount_ug__gt=0)
    held = Holding.objects.filter(some, resource_id__in=list(seen))
    return list(lots.filter(pk__in=held.values("lot_id")))


def standing(lot_ids: Iterable[UUID]) -> dict[LotId, dict[UUID, Amount]]:
    """Return where each lot stands now, by vessel; what is in the waste is not there any more."""
    rows = Holding.objects.filter(lot_id__in=list(lot_ids)).exclude(resource__kind="waste")
    found: dict[LotId, dict[UUID, Amount]] = {}
    for lot, vessel, nl, ug in rows.values_list("lot_id", "resource_id", "amount_nl", "amount_ug"):
        if nl or ug:
            found.setdefault(LotId(str(lot)), {})[vessel] = Amount(nl, ug)
    return found
