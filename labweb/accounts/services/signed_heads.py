"""Sign where the chains of the record end, at intervals."""

from __future__ import annotations

from datetime import datetime

from django.db.transaction import atomic

from labweb.accounts.models import SignedHead
from labweb.accounts.selectors import hash_chains as chains
from labweb.common.clock import now
from labweb.common.signatures import heads_file, signing
from labweb.domain.errors import StateError
from labweb.domain.messages.chain_heads import ChainHead, read_head
from labweb.domain.runs.host_journal.countersigned_heads import check_head


@atomic
def sign_chain(chain: str, end: tuple[int, str] | None) -> SignedHead | None:
    """Sign where a chain ends, unless nothing was added since it was signed last.

    Args:
        chain: Its name.
        end: Number and hash of its last row; None: it has none.

    Returns:
        The head; None: there is nothing to sign.

    Raises:
        StateError: The chain does not go on from where it was signed last: it is shorter, or its
            last row is another. Nothing was signed: a signature would hide it.

    Effect:
        On the record only. The file of the newest heads, which is in no database, follows.
    """
    if end is None:
        return None
    seq, digest = end
    at = now()
    head = ChainHead(chain=chain, seq=seq, hash=digest, at=at.isoformat())
    for known in _known(chain):
        finding = check_head(known, head)
        if finding is not None:
            raise StateError(finding.message, code=finding.code, findings=[finding])
        if known.seq == seq:
            return None
    return _write(head, at)


def _known(chain: str) -> list[ChainHead]:
    """Return the newest heads of a chain that were signed, by the database and by the file."""
    row, last = chains.newest_head(chain), heads_file.last_head(chain)
    bodies = [one.body for one in (row, last) if one is not None]
    return [read_head(body) for body in bodies]


def _write(head: ChainHead, at: datetime) -> SignedHead:
    signed = signing.sign_head(head)
    row = SignedHead.objects.create(
        chain=head.chain,
        seq=head.seq,
        at=at,
        key=signing.record_public_key(),
        body=signed.body,
        signature=signed.signature,
    )
    heads_file.keep_head(head.chain, signed)
    return row
