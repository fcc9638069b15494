"""Ed25519 signatures of commands and of hosts' challenges."""

from __future__ import annotations

import base64
import hashlib
import os
from functools import cache
from pathlib import Path

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from django.conf import settings

from labweb.domain.canonical_json import canonical
from labweb.domain.errors import EnrollmentError
from labweb.domain.messages.chain_heads import ChainHead
from labweb.domain.messages.commands import Command
from labweb.domain.messages.device_looks import LookOrder
from labweb.domain.messages.devices_and_drivers import DriverApproval, Signed
from labweb.domain.messages.driver_tryouts import TryoutOrder


def _key_path() -> Path:
    return Path(os.environ.get("LABWEB_COMMAND_KEY_FILE", settings.DATA_DIR / "command.key"))


def _record_key_path() -> Path:
    return Path(os.environ.get("LABWEB_RECORD_KEY_FILE", settings.DATA_DIR / "record.key"))


def ensure_key() -> None:
    """Create the keys that sign commands and heads, readable by the owner alone, if missing."""
    make_key(_key_path())
    make_key(_record_key_path())


def make_key(path: Path) -> str:
    """Create an Ed25519 key file of mode 0600 unless there is one; return the public half."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            file.write(
                Ed25519PrivateKey.generate().private_bytes(
                    serialization.Encoding.PEM,
                    serialization.PrivateFormat.PKCS8,
                    serialization.NoEncryption(),
                )
            )
    return _public_half(_read_key(path))


def _read_key(path: Path) -> Ed25519PrivateKey:
    key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    if not isinstance(key, Ed25519PrivateKey):
        raise EnrollmentError(f"{path} holds no Ed25519 key", code="host.bad_key")
    return key


def _public_half(key: Ed25519PrivateKey) -> str:
    return base64.b64encode(key.public_key().public_bytes_raw()).decode()


@cache
def _private_key() -> Ed25519PrivateKey:
    return _read_key(_key_path())


@cache
def _record_key() -> Ed25519PrivateKey:
    return _read_key(_record_key_path())


def record_public_key() -> str:
    """Return the public half of the key that signs the heads of the record, base64."""
    return _public_half(_record_key())


def sign_head(head: ChainHead) -> Signed:
    """Sign where a chain ends, with a key that is in no database."""
    body = canonical(head)
    signature = base64.b64encode(_record_key().sign(body)).decode()
    return Signed(body=body.decode(), key_id=id_of(record_public_key()), signature=signature)


def public_key() -> str:
    """Return the public half of the command key, base64."""
    return _public_half(_private_key())


def key_id() -> str:
    """Return a short name of the command key."""
    return id_of(public_key())


def id_of(key: str) -> str:
    """Return a short name of a public key: the start of its SHA-256."""
    return hashlib.sha256(key.encode()).hexdigest()[:16]


def sign(statement: Command | DriverApproval | LookOrder | TryoutOrder) -> Signed:
    """Render a command, an approval or an order to try as text and sign exactly that text."""
    body = canonical(statement)
    signature = base64.b64encode(_private_key().sign(body)).decode()
    return Signed(body=body.decode(), key_id=key_id(), signature=signature)


def is_signed_by(key: str, message: bytes, signature: str) -> bool:
    """Tell whether the signature over the message was made with the private half of `key`."""
    try:
        public = Ed25519PublicKey.from_public_bytes(base64.b64decode(key))
        public.verify(base64.b64decode(signature), message)
    except (InvalidSignature, ValueError):
        return False
    return True
