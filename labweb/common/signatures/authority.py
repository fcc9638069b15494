"""The lab's certificate authority: it vouches for the door and for every edge host.

Its key lies in the data directory, mode 0600, and leaves it never. ECDSA on P-256 signs,
because every TLS library knows it; the keys of hosts are Ed25519.

Source:
    X.509, RFC 5280; signing requests PKCS #10, RFC 2986.
"""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import cache
from pathlib import Path
from uuid import UUID, uuid4

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric.ec import (
    SECP256R1,
    EllipticCurvePrivateKey,
    generate_private_key,
)
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from cryptography.hazmat.primitives.asymmetric.types import CertificatePublicKeyTypes
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from django.conf import settings

from labweb.common.clock import now
from labweb.domain.enrollment.host_join import CERTIFICATE_S, SERVER_NAME
from labweb.domain.errors import EnrollmentError

_LIVES = timedelta(days=20 * 365)
_LONGEST_SKEW = timedelta(minutes=5)

_PEM = serialization.Encoding.PEM


@dataclass(frozen=True, slots=True)
class Authority:
    """The key that signs certificates, and its own certificate."""

    key: EllipticCurvePrivateKey
    certificate: x509.Certificate


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate as the server keeps it."""

    pem: str
    fingerprint: str
    """SHA-256 of the DER form, hex."""

    serial: str
    public_key: str
    """Ed25519, base64 of the raw bytes."""

    not_before: datetime
    not_after: datetime


def authority_path() -> Path:
    """Return where key and certificate of the authority lie."""
    return Path(os.environ.get("LABWEB_AUTHORITY_FILE", settings.DATA_DIR / "authority.pem"))


def authority() -> Authority:
    """Return the lab's authority; the first caller makes it.

    Raises:
        EnrollmentError: The file is open to others, or holds no authority.
    """
    return _load(authority_path())


@cache
def _load(path: Path) -> Authority:
    if not path.exists():
        _create(path)
    if path.stat().st_mode & 0o077:
        raise EnrollmentError(f"{path} is open to others: set its mode to 0600", code="ca.unusable")
    content = path.read_bytes()
    try:
        key = serialization.load_pem_private_key(content, password=None)
        certificate = x509.load_pem_x509_certificate(content)
    except ValueError as error:
        raise EnrollmentError(f"{path} holds no authority: {error}", code="ca.unusable") from error
    if not isinstance(key, EllipticCurvePrivateKey):
        raise EnrollmentError(f"{path} holds no key on P-256", code="ca.unusable")
    return Authority(key, certificate)


def _create(path: Path) -> None:
    """Make the authority; of two processes that do so at once, the first one's stays."""
    key = generate_private_key(SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "labweb authority")])
    builder = _builder(name, name, key.public_key(), now() - _LONGEST_SKEW, now() + _LIVES)
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    builder = builder.add_extension(_usage(is_authority=True), critical=True)
    certificate = builder.sign(key, hashes.SHA256())
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    fresh = path.with_name(f".{path.name}.{uuid4().hex}")
    write_key(fresh, key, [certificate])
    try:
        with suppress(FileExistsError):
            os.link(fresh, path)
    finally:
        fresh.unlink()


def write_key(
    path: Path, key: EllipticCurvePrivateKey, certificates: Sequence[x509.Certificate]
) -> None:
    """Write a key with its certificates, readable by its owner alone."""
    text = key.private_bytes(
        _PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    ) + b"".join(one.public_bytes(_PEM) for one in certificates)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def authority_pem() -> str:
    """Return the authority's certificate, PEM."""
    return authority().certificate.public_bytes(_PEM).decode()


def authority_hash() -> str:
    """Return the SHA-256 of the authority's public key, hex: what a join token carries."""
    return hashlib.sha256(
        authority()
        .certificate.public_key()
        .public_bytes(serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo)
    ).hexdigest()


def fingerprint_of(der: bytes) -> str:
    """Return the SHA-256 of a certificate, hex."""
    return hashlib.sha256(der).hexdigest()


def requested_key(csr: str) -> str:
    """Return the key that a signing request is for, base64; the request proves it is held.

    Raises:
        EnrollmentError: It is no request, its signature does not hold, or the key is not
            Ed25519.
    """
    return base64.b64encode(_requested(csr).public_bytes_raw()).decode()


def _requested(csr: str) -> Ed25519PublicKey:
    try:
        request = x509.load_pem_x509_csr(csr.encode())
        is_signed = request.is_signature_valid
        key = request.public_key()
    except Exception as error:  # a stranger's bytes: the parser raises many sorts
        raise EnrollmentError("this is no signing request", code="join.bad_csr") from error
    if not is_signed or not isinstance(key, Ed25519PublicKey):
        raise EnrollmentError(
            "the signing request is not signed by the Ed25519 key that it names",
            code="join.bad_csr",
        )
    return key


def issue_to_host(csr: str, host_id: UUID) -> Issued:
    """Certify the key of a signing request as a host's; nothing else of the request is taken.

    Raises:
        EnrollmentError: As `requested_key`.
    """
    key = _requested(csr)
    lives = timedelta(seconds=settings.HOST_CERTIFICATE_S)
    begins = now() - min(_LONGEST_SKEW, lives / 100)
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, str(host_id))])
    builder = _builder(authority().certificate.subject, name, key, begins, now() + lives)
    made = _sign_leaf(builder, ExtendedKeyUsageOID.CLIENT_AUTH)
    return Issued(
        pem=made.public_bytes(_PEM).decode(),
        fingerprint=fingerprint_of(made.public_bytes(serialization.Encoding.DER)),
        serial=f"{made.serial_number:x}",
        public_key=base64.b64encode(key.public_bytes_raw()).decode(),
        not_before=made.not_valid_before_utc,
        not_after=made.not_valid_after_utc,
    )


def issue_to_door(path: Path) -> datetime:
    """Write a fresh key and certificate for the door; return when it ends.

    It names the lab and no address, so that the lab may move.
    """
    key = generate_private_key(SECP256R1())
    ends = now() + timedelta(seconds=CERTIFICATE_S)
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, SERVER_NAME)])
    issuer = authority().certificate.subject
    builder = _builder(issuer, name, key.public_key(), now() - _LONGEST_SKEW, ends)
    names = x509.SubjectAlternativeName([x509.DNSName(SERVER_NAME)])
    builder = builder.add_extension(names, critical=False)
    made = _sign_leaf(builder, ExtendedKeyUsageOID.SERVER_AUTH)
    fresh = path.with_name(f".{path.name}.new")
    write_key(fresh, key, [made, authority().certificate])
    fresh.replace(path)
    return ends


def _builder(
    issuer: x509.Name,
    subject: x509.Name,
    key: CertificatePublicKeyTypes,
    begins: datetime,
    ends: datetime,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .issuer_name(issuer)
        .subject_name(subject)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(begins)
        .not_valid_after(ends)
        .add_extension(
            x509.SubjectKeyIdentifier.from_public_key(key),
            critical=False,
        )
    )


def _sign_leaf(
    builder: x509.CertificateBuilder, purpose: x509.ObjectIdentifier
) -> x509.Certificate:
    ours = authority()
    of_authority = ours.certificate.extensions.get_extension_for_class(x509.SubjectKeyIdentifier)
    issuer_key = x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(of_authority.value)
    return (
        builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(is_authority=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        .add_extension(issuer_key, critical=False)
        .sign(ours.key, hashes.SHA256())
    )


def _usage(*, is_authority: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not is_authority,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=is_authority,
        crl_sign=is_authority,
        encipher_only=False,
        decipher_only=False,
    )
