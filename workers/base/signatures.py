"""Signatures of the server: is a command signed by a key that it has?

Source:
    Ed25519, RFC 8032; keys and signatures travel as base64 of their raw bytes.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping
from functools import lru_cache

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import (
    Ed25519PublicKey,
)

from labweb.domain.messages.devices_and_drivers import Signed


def is_signature(public_base64: str, content: bytes, signature: str) -> bool:
    """Say whether this key signed exactly these bytes."""
    try:
        text = base64.b64decode(signature, validate=True)
        _public_key(public_base64).verify(text, content)
    except (InvalidSignature, ValueError, binascii.Error):
        return False
    return True


def is_signed(signed: Signed, keys: Mapping[str, str]) -> bool:
    """Say whether a known key of the server signed exactly this text."""
    public = keys.get(signed.key_id)
    return public is not None and is_signature(public, signed.body.encode(), signed.signature)


@lru_cache(maxsize=16)
def _public_key(text: str) -> Ed25519PublicKey:
    return Ed25519PublicKey.from_public_bytes(base64.b64decode(text, validate=True))
