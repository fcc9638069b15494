"""What was delivered, as the ledger tells it."""

from __future__ import annotations

from labweb.crutd.models import Entry
from labweb.domain.crutd.delivery_table import Delivery, DeliveryShare
from labweb.domain.crutd.ledger import Account
from labweb.domain.resources.contents_by_lot import Phase
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab


def deliveries_of(lab: Lab) -> list[Delivery]:
    """Return every lot that was received, with the vessels that it came into, by lot key."""
    rows = Entry.objects.filter(
        lot__lab=lab, debit=Account.RECEIPT.value, state=Entry.State.POSTED
    ).order_by("id")
    shares: dict[str, dict[str, int]] = {}
    for lot, credit, liquid, mass in rows.values_list("lot", "credit", "amount_nl", "amount_ug"):
        into = shares.setdefault(str(lot), {})
        into[credit] = into.get(credit, 0) + liquid + mass
    keys = {str(row.pk): row.key for row in resource_selectors.resources_of(lab)}
    lots = resource_selectors.find_lots(shares).select_related("material").order_by("key")
    return [
        Delivery(
            lot=lot.key,
            material=lot.material.key,
            phase=Phase(lot.phase),
            shares=tuple(
                DeliveryShare(row=0, vessel=keys[vessel], amount=amount)
                for vessel, amount in shares[str(lot.pk)].items()
                if vessel in keys
            ),
            supplier=lot.supplier,
            number=lot.number,
            purity=lot.purity,
            expires_on=lot.expires_on,
        )
        for lot in lots
    ]
