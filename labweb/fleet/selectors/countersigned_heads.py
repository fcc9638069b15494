"""The heads of the record's chains, with what hosts have countersigned, to be taken elsewhere."""

from __future__ import annotations

from labweb.accounts.selectors import hash_chains as chains
from labweb.accounts.selectors.hash_chains import HeadsFile
from labweb.domain.messages.chain_heads import Countersigned
from labweb.runs.selectors.events_of_hosts import countersigned_events


def heads_file() -> HeadsFile:
    """Return the newest signed head of each chain, once for each host that countersigned it."""
    found = []
    for row in chains.newest_heads():
        signed = chains.signed_of(row)
        events = countersigned_events(row.chain, row.signature)
        own = [str(event.body["countersignature"]) for event in events]
        found += [
            Countersigned(key=row.key, signed=signed, countersignature=one) for one in own or [""]
        ]
    return HeadsFile(heads=found)
