"""The private key of this host: made once, never overwritten, and read by nobody else.

Source:
    Ed25519, RFC 8032; keys and signatures travel as base64 of their raw bytes.
"""

from __future__ import annotations

import base64
import os
from pathlib import Path

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import (
    Ed25519PrivateKey,
)

from labweb.domain.errors import EnrollmentError
from labweb.domain.messages.session import Hello, hello_bytes


class HostKey:
    """The private key of one host. It never leaves the machine."""

    def __init__(self, key: Ed25519PrivateKey) -> None:
        self.private = key

    @property
    def public_raw(self) -> bytes:
        """Return the public key, 32 bytes."""
        return self.private.public_key().public_bytes_raw()

    @property
    def public_base64(self) -> str:
        """Return the public key as the server stores it."""
        return base64.b64encode(self.public_raw).decode()

    @property
    def pem(self) -> bytes:
        """Return the private key as its file holds it."""
        return self.private.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )

    def sign(self, content: bytes) -> str:
        """Sign the bytes; base64."""
        return base64.b64encode(self.private.sign(content)).decode()

    def sign_hello(self, hello: Hello, nonce: str) -> str:
        """Prove to the server that this host holds its key."""
        return self.sign(hello_bytes(hello, nonce))


def create_key(path: Path) -> HostKey:
    """Make a new key and store it, readable by its owner alone.

    Raises:
        EnrollmentError: The file exists already; a key is never overwritten.
    """
    key = HostKey(Ed25519PrivateKey.generate())
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError as exc:
        raise EnrollmentError(f"{path} exists: a host's key is never overwritten") from exc
    with os.fdopen(handle, "wb") as stream:
        stream.write(key.pem)
        stream.flush()
        os.fsync(stream.fileno())
    return key


def write_private(path: Path, content: bytes) -> None:
    """Replace a file in one step that a crash does not undo, readable by its owner alone."""
    fresh = path.with_name(f".{path.name}.new")
    handle = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(handle, "wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    fresh.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def load_key(path: Path) -> HostKey:
    """Read the host's key.

    Raises:
        EnrollmentError: It is missing, open to others, or no Ed25519 key.
    """
    try:
        if path.stat().st_mode & 0o077:
            raise EnrollmentError(f"{path} is open to others: set its mode to 0600")
        key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    except (OSError, ValueError) as exc:
        raise EnrollmentError(f"cannot read the host's key {path}: {exc}") from exc
    if not isinstance(key, Ed25519PrivateKey):
        raise EnrollmentError(f"{path} holds no Ed25519 key")
    return HostKey(key)
