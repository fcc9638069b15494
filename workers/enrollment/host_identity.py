"""Who this host is to the server: its key, its certificate, and the authority it trusts.

One file holds the key and the certificate, and is replaced whole, so that a crash never
leaves a key with the certificate of another.
"""

from __future__ import annotations

import logging
import ssl
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric.ec import ECDSA, EllipticCurvePublicKey
from cryptography.x509.oid import NameOID

from labweb.domain.enrollment.host_join import SERVER_NAME, renew_due_s
from labweb.domain.errors import EnrollmentError
from workers.base.host_key import HostKey, create_key, load_key, write_private

log = logging.getLogger(__name__)

NEXT = ".next"
"""Ending of the file with the key that the next certificate is asked for."""


@dataclass(frozen=True, slots=True)
class HostIdentity:
    """What a connection to the server is opened with."""

    key: HostKey
    key_file: Path
    ca_file: Path | None
    """None: over loopback, without TLS."""

    renew_due_s: float | None
    """When the next certificate is due, in seconds of the Unix epoch; None: there is none."""

    def context(self) -> ssl.SSLContext | None:
        """Return TLS with a certificate on both sides; None: over loopback, without."""
        if self.ca_file is None:
            return None
        context = verifying_context(self.ca_file.read_text("ascii"))
        context.load_cert_chain(self.key_file)
        return context


def verifying_context(authority: str) -> ssl.SSLContext:
    """Return TLS that trusts this lab's authority and nobody else."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.load_verify_locations(cadata=authority)
    return context


def server_name(identity: HostIdentity) -> str | None:
    """Return the name that the server's certificate must have; it is the lab's, not an address."""
    return None if identity.ca_file is None else SERVER_NAME


def load_identity(key_file: Path, ca_file: Path | None) -> HostIdentity:
    """Read who this host is.

    Raises:
        EnrollmentError: Key or certificate are missing, open to others, or do not fit.
    """
    key = load_key(key_file)
    if ca_file is None:
        return HostIdentity(key, key_file, None, None)
    try:
        certificate = x509.load_pem_x509_certificate(key_file.read_bytes())
    except ValueError as error:
        text = f"{key_file} holds no certificate: run python -m workers.enrollment.join"
        raise EnrollmentError(text, code="host.no_certificate") from error
    due_s = renew_due_s(
        certificate.not_valid_before_utc.timestamp(), certificate.not_valid_after_utc.timestamp()
    )
    return HostIdentity(key, key_file, ca_file, due_s)


def signing_request(key: HostKey) -> str:
    """Return a request to certify this key, PEM; it says nothing else."""
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "edge host")])
    request = x509.CertificateSigningRequestBuilder().subject_name(name).sign(key.private, None)
    return request.public_bytes(serialization.Encoding.PEM).decode()


def next_key(key_file: Path) -> HostKey:
    """Return the key that follows the present one; made once, and kept until it is in use."""
    path = key_file.with_name(key_file.name + NEXT)
    return load_key(path) if path.exists() else create_key(path)


def take_certificate(key_file: Path, key: HostKey, certificate: str, authority: str) -> None:
    """Put a key with its certificate in the place of what was there, in one step.

    Raises:
        EnrollmentError: The certificate is not for this key, or not of this authority.
            Nothing changed.
    """
    check_certificate(key, certificate, authority)
    write_private(key_file, key.pem + certificate.encode())
    key_file.with_name(key_file.name + NEXT).unlink(missing_ok=True)


def renewed(who: HostIdentity, certificate: str) -> HostIdentity:
    """Put the next key and its certificate in the place of the present ones; return who this is.

    Raises:
        EnrollmentError: The certificate is not for the next key, or not of this authority.
            Nothing changed.
    """
    if who.ca_file is None:
        return who
    authority = who.ca_file.read_text("ascii")
    take_certificate(who.key_file, next_key(who.key_file), certificate, authority)
    log.info("the next certificate is in use")
    return load_identity(who.key_file, who.ca_file)


def check_certificate(key: HostKey, certificate: str, authority: str) -> None:
    """Refuse a certificate that is not for this key, or not of this authority.

    Raises:
        EnrollmentError: So it is.
    """
    try:
        ours = x509.load_pem_x509_certificate(certificate.encode())
        signer = x509.load_pem_x509_certificate(authority.encode()).public_key()
        is_ours = isinstance(signer, EllipticCurvePublicKey)
        if isinstance(signer, EllipticCurvePublicKey):
            signer.verify(ours.signature, ours.tbs_certificate_bytes, ECDSA(hashes.SHA256()))
    except Exception as error:  # whatever came over the wire: the parser raises many sorts
        text = "the server sent a certificate that the lab's authority did not sign"
        raise EnrollmentError(text, code="join.bad_certificate") from error
    if not is_ours or ours.public_key() != key.private.public_key():
        text = "the server sent a certificate for another key"
        raise EnrollmentError(text, code="join.bad_certificate")


def key_hash(authority: str) -> str:
    """Return the SHA-256 of an authority's public key, hex: what a join token carries.

    Raises:
        ValueError: This is no certificate.
    """
    public = x509.load_pem_x509_certificate(authority.encode()).public_key()
    digest = hashes.Hash(hashes.SHA256())
    digest.update(
        public.public_bytes(
            serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
        )
    )
    return digest.finalize().hex()
