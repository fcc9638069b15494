"""Heads of chains: how far a record reached at a time, signed outside of its database.

Each row of a chain binds all rows before it, so that the hash of the last one stands for all of
them. Whoever can write to the database can hash every row again; a head that was signed with a key
which is not in there, and that hosts keep too, then fits no more.
"""

from __future__ import annotations

import msgspec

from labweb.domain.canonical_json import canonical
from labweb.domain.messages.devices_and_drivers import Signed


class ChainHead(msgspec.Struct, frozen=True, tag="head", tag_field="t", kw_only=True):
    """Where a chain ended at a time."""

    chain: str
    """`audit`, `decisions`, or `events:` and the id of a lab."""

    seq: int
    """Number of its last row."""

    hash: str
    """Of that row, over all before it: SHA-256, hex."""

    at: str
    """When it was signed, by the server's clock: ISO 8601, UTC."""


class Heads(msgspec.Struct, frozen=True, tag="heads", tag_field="t", kw_only=True):
    """Heads for a host to countersign and keep."""

    key: str
    """Public half of the key that signed them: Ed25519, base64."""

    signed: list[Signed]
    """A signed `ChainHead` each."""


class Countersigned(msgspec.Struct, frozen=True, kw_only=True):
    """A head as a host keeps it: the newest of its chain and key."""

    key: str
    signed: Signed
    countersignature: str
    """Ed25519 of the host over `countersigned_bytes`, base64."""


def read_head(body: str) -> ChainHead:
    """Read the signed text of a head.

    Raises:
        msgspec.ValidationError: It is none.
    """
    return msgspec.json.decode(body, type=ChainHead)


def countersigned_bytes(key: str, signed: Signed) -> bytes:
    """Return what a host signs of a head: its text, the server's signature and key."""
    return canonical({"head": signed.body, "key": key, "signature": signed.signature})
