"""The heads of the record's chains, with what hosts have countersigned, to be taken elsewhere."""

from __future__ import annotations

from labweb.accounts.selectors import hash_chains as chains
from labweb.accounts.selectors.hash_chains import HeadsFile
from labweb.domain.messages.chain_heads import Countersigned
from labweb.runs.models import HostEvent


def heads_file() -> HeadsFile:
    """Return the newest signed head of each chain, once for each host that countersigned it."""
    found = []
    for row in chains.newest_heads():
        signed = chains.signed_of(row)
        events = HostEvent.objects.filter(
            kind="countersigned", body__chain=row.chain, body__signature=row.signature
        )
        own = [str(event.body["countersignature"]) for event in events.order_by("id")]
        found += [
            Countersigned(key=row.key, signed=signed, countersignature=one) for one in own or [""]
        ]
    return HeadsFile(heads=found)
