"""Do the chains of the record hold, and do they fit the heads that were signed of them?"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from labweb.accounts.models import AuditEntry, SignedHead
from labweb.common.signatures import heads_file, signing
from labweb.domain.canonical_json import canonical
from labweb.domain.errors import DefinitionError, Finding
from labweb.domain.messages.chain_heads import ChainHead, Countersigned, read_head
from labweb.domain.messages.devices_and_drivers import Signed

AUDIT, DECISIONS, EVENTS = "audit", "decisions", "events:"

_AT_ONCE = 2000


class HeadsFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Heads that were taken out of the server, to be held against it later."""

    format: str = "labweb heads"
    version: int = 1
    heads: list[Countersigned]
    """The newest of each chain and key; countersigned by a host, or by nobody."""

    time_stamps: list[str] = msgspec.field(default_factory=list)
    """Answers of time-stamping authorities over `stamped_bytes`: DER, base64 (RFC 3161)."""


def stamped_bytes(file: HeadsFile) -> bytes:
    """Return what an authority stamps: the heads, without any stamp."""
    return canonical(msgspec.structs.replace(file, time_stamps=[]))


def read_heads_file(raw: bytes) -> HeadsFile:
    """Read a file of heads.

    Raises:
        DefinitionError: It is none.
    """
    try:
        file = msgspec.json.decode(raw, type=HeadsFile)
        for one in file.heads:
            read_head(one.signed.body)
    except msgspec.MsgspecError as error:
        raise DefinitionError(
            f"this is no file of signed heads: {error}", code="records.bad_file"
        ) from error
    if (file.format, file.version) != ("labweb heads", 1):
        text = f"this is {file.format!r} in version {file.version}, not 'labweb heads' in version 1"
        raise DefinitionError(text, code="records.bad_file")
    return file


def kept_heads(path: Path | None) -> list[Countersigned]:
    """Return the heads of a file; None: there is no file.

    Raises:
        DefinitionError: It cannot be read, or is none.
    """
    if path is None:
        return []
    try:
        return read_heads_file(path.read_bytes()).heads
    except OSError as error:
        text = f"{path} cannot be read: {error.strerror}"
        raise DefinitionError(text, code="records.bad_file") from error


def audit_hash(prev: str, entry: AuditEntry) -> str:
    """Return the SHA-256 that binds an entry of the audit trail to all before it."""
    fields: Mapping[str, Any] = {
        "prev": prev,
        "at": entry.at.isoformat(),
        "actor": None if entry.actor_id is None else str(entry.actor_id),
        "action": entry.action,
        "subject": entry.subject,
        "reason": entry.reason,
        "detail": entry.detail,
    }
    return hashlib.sha256(canonical(fields)).hexdigest()


def first_broken_entry() -> Finding | None:
    """Return the first entry of the audit trail that is not as it was written, or None."""
    prev = ""
    for entry in _entries():
        row = str(entry.id)
        if entry.prev_hash != prev:
            text = f"audit entry {row} does not follow the one before: rows were removed or moved"
            return Finding("audit.reordered", text, row)
        if audit_hash(prev, entry) != entry.hash:
            text = f"audit entry {row} was edited: it does not fit its own hash"
            return Finding("audit.edited", text, row)
        prev = entry.hash
    return None


def _entries() -> Iterable[AuditEntry]:
    last = 0
    while batch := list(AuditEntry.objects.filter(id__gt=last).order_by("id")[:_AT_ONCE]):
        yield from batch
        last = batch[-1].id


def end_of_audit_chain() -> tuple[int, str] | None:
    """Return number and hash of the last entry of the audit trail; None: there is none."""
    row = AuditEntry.objects.order_by("-id").values_list("id", "hash").first()
    return None if row is None else (row[0], row[1])


def audit_hash_at(seq: int) -> str | None:
    """Return the hash of one entry of the audit trail; None: there is none of that number."""
    return AuditEntry.objects.filter(id=seq).values_list("hash", flat=True).first()


def newest_heads() -> list[SignedHead]:
    """Return the newest signed head of each chain."""
    return list(SignedHead.objects.order_by("chain", "-seq").distinct("chain"))


def newest_head(chain: str) -> SignedHead | None:
    """Return the newest signed head of a chain, or None."""
    return SignedHead.objects.filter(chain=chain).order_by("-seq").first()


def signed_of(row: SignedHead) -> Signed:
    """Return a head as it travels."""
    return Signed(body=row.body, key_id=signing.id_of(row.key), signature=row.signature)


def first_broken_head(
    chain: str, hash_at: Callable[[int], str | None], kept: Sequence[Countersigned] = ()
) -> Finding | None:
    """Return the first signed head that a chain does not fit, or None.

    Args:
        chain: Which.
        hash_at: Tells the hash of a row of it, by its number.
        kept: Heads that were kept elsewhere, of any chain.
    """
    last = heads_file.last_head(chain)
    heads = [(row.key, row.body, row.signature) for row in _rows(chain)]
    heads += [(one.key, one.signed.body, one.signed.signature) for one in kept]
    if last is not None:
        heads.append((signing.record_public_key(), last.body, last.signature))
    for key, body, signature in heads:
        head = read_head(body)
        if head.chain != chain:
            continue
        broken = _broken_signature(head, key, body, signature) or _broken_row(head, hash_at)
        if broken is not None:
            return broken
    return None


def _rows(chain: str) -> Iterable[SignedHead]:
    return SignedHead.objects.filter(chain=chain).order_by("seq").iterator(_AT_ONCE)


def _broken_signature(head: ChainHead, key: str, body: str, signature: str) -> Finding | None:
    context = {"seq": head.seq, "signed_at": head.at}
    if key != signing.record_public_key():
        text = (
            f"the head of {head.chain} at row {head.seq}, {head.at}, was signed with another key "
            f"({signing.id_of(key)}) than this server's"
        )
        return Finding("records.other_key", text, str(head.seq), context)
    if not signing.is_signed_by(key, body.encode(), signature):
        text = f"the signature of the head of {head.chain} at row {head.seq} does not hold"
        return Finding("records.bad_signature", text, str(head.seq), context)
    return None


def _broken_row(head: ChainHead, hash_at: Callable[[int], str | None]) -> Finding | None:
    found = hash_at(head.seq)
    if found == head.hash:
        return None
    text = (
        f"{head.chain} was signed at row {head.seq} on {head.at}, and "
        + ("has no such row any more" if found is None else "that row has another hash since")
        + ": the chain up to there was written again"
    )
    context = {"seq": head.seq, "signed_at": head.at, "signed": head.hash, "found": found}
    return Finding("records.conflict", text, str(head.seq), context)
