"""A host's side of the server's signed heads: it keeps the newest, and tells of what cannot be.

A host is the witness of the server's record: what it has countersigned it does not let the server
take back. It keeps one head of each chain and key, for the last one stands for all rows before it.
"""

from __future__ import annotations

import msgspec

from labweb.domain.canonical_json import canonical
from labweb.domain.errors import Finding
from labweb.domain.messages.chain_heads import ChainHead, Countersigned, read_head
from labweb.domain.messages.devices_and_drivers import Signed
from labweb.domain.runs.host_journal.journal_rows import JournalWrite

META = "heads"

CONFLICT = "records.conflict"
"""The chain is shorter than it was, or has another row where it ended."""

OTHER_KEY = "records.other_key"
"""Another key than before signs the heads of a chain."""


def check_head(known: ChainHead | None, head: ChainHead) -> Finding | None:
    """Say why a chain cannot have grown from one head to another; None: it can.

    Example:
        >>> early = ChainHead(chain="audit", seq=7, hash="a", at="")
        >>> check_head(early, ChainHead(chain="audit", seq=9, hash="b", at=""))
        >>> check_head(early, ChainHead(chain="audit", seq=6, hash="b", at="")).code
        'records.conflict'
    """
    if known is None or head.seq > known.seq:
        return None
    if head.seq < known.seq:
        text = f"{head.chain} ended at row {known.seq} on {known.at}, and ends at row {head.seq}"
        return Finding(CONFLICT, text, head.chain)
    if head.hash != known.hash:
        text = f"row {head.seq} of {head.chain} had another hash on {known.at}"
        return Finding(CONFLICT, text, head.chain)
    return None


def kept_heads(text: str | None) -> dict[str, Countersigned]:
    """Read the heads that a host keeps, by key and chain."""
    return msgspec.json.decode(text or "{}", type=dict[str, Countersigned])


def read_kept(kept: Countersigned) -> ChainHead:
    """Return what a kept head says."""
    return read_head(kept.signed.body)


def write_head(tx: JournalWrite, key: str, signed: Signed, countersignature: str) -> None:
    """Keep a head whose signature holds, if its chain can have grown to it; else tell of it.

    Args:
        tx: The write.
        key: Public half of the key that signed it.
        signed: The head.
        countersignature: This host's own signature over `countersigned_bytes`.

    Effect:
        On the record only: `countersigned`, or `head_refused` with what was known. A refused head
        replaces nothing.
    """
    kept = kept_heads(tx.meta().get(META))
    head = read_head(signed.body)
    place = f"{key} {head.chain}"
    known = kept.get(place)
    body = {
        **msgspec.to_builtins(head),
        "key": key,
        "signature": signed.signature,
        "countersignature": countersignature,
    }
    finding = check_head(None if known is None else read_kept(known), head)
    if finding is not None and known is not None:
        body |= {"code": finding.code, "message": finding.message, "known": known.signed.body}
        tx.append("head_refused", None, body)
        return
    if known is not None and read_kept(known).seq == head.seq:
        return
    if known is None and (others := _signed_by_others(kept, key, head.chain)):
        text = f"{head.chain} was signed with another key until {max(others)}"
        body |= {"code": OTHER_KEY, "message": text}
    kept[place] = Countersigned(key=key, signed=signed, countersignature=countersignature)
    tx.set_meta(META, canonical(kept).decode())
    tx.append("countersigned", None, body)


def _signed_by_others(kept: dict[str, Countersigned], key: str, chain: str) -> list[str]:
    heads = [read_kept(one) for one in kept.values() if one.key != key]
    return [head.at for head in heads if head.chain == chain]
