"""Certificates of hosts: issued, renewed under load, judged at the start of a session."""

from __future__ import annotations

from uuid import UUID

from django.db.transaction import atomic

from labweb.accounts import services as account_services
from labweb.common.clock import now
from labweb.common.signatures import authority
from labweb.domain.errors import EnrollmentError
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.enrollment import selectors
from labweb.enrollment.models import EdgeHost, HostCertificate

_OVER = frozenset(
    {SessionState.QUARANTINED.value, SessionState.FENCED.value, SessionState.REVOKED.value}
)


def keep_certificate(host: EdgeHost, csr: str) -> HostCertificate:
    """Issue a certificate for a host's key; asked again for the same key it is the same one."""
    key = authority.requested_key(csr)
    known = host.certificates.filter(public_key=key, ended_at__isnull=True).first()
    if known is not None:
        return known
    made = authority.issue_to_host(csr, host.id)
    return HostCertificate.objects.create(
        host=host,
        serial=made.serial,
        fingerprint=made.fingerprint,
        public_key=made.public_key,
        pem=made.pem,
        not_before=made.not_before,
        not_after=made.not_after,
        issued_at=now(),
    )


@atomic
def renew_certificate(host_id: UUID, epoch: int, csr: str) -> HostCertificate:
    """Issue a host's next certificate, asked for in a session that the present key opened.

    Raises:
        EnrollmentError: The session is over, the host is suspended, or the request is none.

    Effect:
        None on matter. Both certificates are good until the next has opened a session.
    """
    host = selectors.host_for_update(host_id)
    if host.epoch != epoch or host.state in _OVER:
        raise EnrollmentError("this session is over", code="host.no_session")
    if host.suspended_at is not None:
        raise EnrollmentError("a person has to look at this host first", code="host.suspended")
    key = authority.requested_key(csr)
    elsewhere = selectors.is_key_known(key) and not host.certificates.filter(public_key=key)
    if elsewhere:
        raise EnrollmentError("this key was used before: make another", code="join.known_key")
    known = set(host.certificates.values_list("pk", flat=True))
    row = keep_certificate(host, csr)
    if row.pk not in known:
        detail = {"serial": row.serial, "until": row.not_after.isoformat()}
        account_services.write_audit("host.renew", str(host.id), actor=None, detail=detail)
    return row


def check_certificate(host: EdgeHost, der: bytes | None) -> str:
    """Return the key that signs a host's HELLO, by the certificate of its connection.

    A host of the server's own machine has none: it speaks over loopback, with the key that
    was written at the first start.

    Raises:
        EnrollmentError: The certificate is missing, another host's, or no good any more.
    """
    certificates = HostCertificate.objects.filter(host=host)
    if der is None and not certificates.exists():
        return host.public_key
    if der is None:
        text = "this host speaks through the door, with its certificate"
        raise EnrollmentError(text, code="host.no_certificate")
    row = certificates.filter(fingerprint=authority.fingerprint_of(der)).first()
    if row is None:
        raise EnrollmentError("the certificate is not this host's", code="host.other_certificate")
    if host.state == SessionState.REVOKED.value:
        raise EnrollmentError("this host's key was revoked", code="host.revoked")
    if row.ended_at is not None or row.not_after <= now():
        text = "the certificate is over: this machine has to join again"
        raise EnrollmentError(text, code="host.certificate_over")
    return row.public_key


def note_use(host: EdgeHost, der: bytes | None) -> None:
    """Note that a certificate opened a session; those from before it are over."""
    if der is None:
        return
    row = host.certificates.get(fingerprint=authority.fingerprint_of(der))
    if row.used_at is not None:
        return
    row.used_at = now()
    row.save(update_fields=["used_at"])
    older = host.certificates.filter(issued_at__lt=row.issued_at, ended_at__isnull=True)
    older.update(ended_at=now())
    EdgeHost.objects.filter(pk=host.pk).update(public_key=row.public_key)
