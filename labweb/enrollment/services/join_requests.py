"""Writes about machines that ask to become hosts: tokens, requests, a person's answer."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from uuid import UUID

from django.conf import settings
from django.db.transaction import atomic, on_commit

from labweb.accounts import services as account_services
from labweb.accounts.selectors import User
from labweb.common import feed
from labweb.common.clock import new_id, now
from labweb.common.signatures import authority
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.enrollment.admission_reason import refuse_no_reason
from labweb.domain.enrollment.host_join import (
    LONGEST_NAME,
    LONGEST_TOKEN_S,
    SECRET_BYTES,
    USUAL_TOKEN_S,
    AdmittedHost,
    JoinAsk,
    JoinWaiting,
    Token,
    check_ask,
    find_known,
    is_code,
    is_name,
    is_secret,
    key_of_name,
    render_token,
    secret_hash,
)
from labweb.domain.errors import DefinitionError, EnrollmentError, StateError
from labweb.domain.messages.session import Refuse
from labweb.domain.runs.host_link.host_session import SessionState, readmitted
from labweb.enrollment import selectors
from labweb.enrollment.models import EdgeHost, HostCertificate, JoinRequest, JoinToken
from labweb.enrollment.services.certificates import keep_certificate
from labweb.enrollment.services.host_messages import join_group
from labweb.enrollment.services.hosts import CLOSED, keep_record, record_of
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab

_REFUSED = "the token is unknown, used up, withdrawn or expired: ask an admin for another"


@dataclass(frozen=True, slots=True)
class MadeToken:
    """A token at the one moment at which it is readable."""

    row: JoinToken
    text: str


def require_admission(actor: User, lab: Lab) -> None:
    """Refuse who may not admit hosts.

    Raises:
        ForbiddenError: The actor may not.
    """
    resource_selectors.require(actor, Permission.ADMIT, [resource_selectors.root_of(lab).id])


@atomic
def make_token(
    lab: Lab, *, actor: User, name: str = "", lifetime_s: float = USUAL_TOKEN_S
) -> MadeToken:
    """Make leave for one machine to ask, once, within the hour.

    Raises:
        ForbiddenError: The actor may not admit hosts.
        DefinitionError: The name is none, or the time is not within the hour.

    Effect:
        None on matter. The secret is in the answer and nowhere else.
    """
    require_admission(actor, lab)
    if not 0 < lifetime_s <= LONGEST_TOKEN_S:
        text = f"a token lives for more than 0 and at most {LONGEST_TOKEN_S / 60:g} minutes"
        raise DefinitionError(text, code="join.lifetime")
    if name and not is_name(name):
        text = f"the name has 1 to {LONGEST_NAME} legible signs, a letter or digit among them"
        raise DefinitionError(text, code="join.name")
    secret = secrets.token_hex(SECRET_BYTES)
    at = now()
    row = JoinToken.objects.create(
        lab=lab,
        name=name,
        secret_hash=secret_hash(secret),
        created_by=actor,
        created_at=at,
        expires_at=at + timedelta(seconds=lifetime_s),
    )
    account_services.write_audit(
        "host.token_made", str(row.id), actor=actor, detail={"name": name, "lives_s": lifetime_s}
    )
    return MadeToken(row, render_token(Token(authority.authority_hash(), row.id, secret)))


def join_command(token: str) -> str:
    """Return what is typed on the new host; without a door, its address is left to fill in."""
    address = settings.EDGE_ADDRESS or "ADDRESS:PORT"
    return f"python -m workers.enrollment.join --server {address} --token {token}"


@atomic
def withdraw_token(token_id: UUID, *, actor: User) -> JoinToken:
    """Take a token back that nobody has used.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: The actor may not admit hosts.
        StateError: It is used up or withdrawn already.
    """
    row = selectors.token_for_update(token_id)
    require_admission(actor, row.lab)
    if row.used_at is not None or row.withdrawn_at is not None:
        raise StateError("this token opens nothing any more", code="join.token_over")
    row.withdrawn_at = now()
    row.save(update_fields=["withdrawn_at"])
    account_services.write_audit("host.token_withdrawn", str(row.id), actor=actor)
    return row


@atomic
def take_request(ask: JoinAsk, *, address: str = "") -> JoinRequest:
    """Take in what a machine asks; asked again with the same key it is the same request.

    Raises:
        EnrollmentError: The token opens nothing, the request is malformed, or its key is
            known. Nothing changed.

    Effect:
        None on matter. Should the machine claim to be a host that is known, that host gets
        nothing new before a person has said which of them it is.
    """
    fault = check_ask(ask)
    if fault:
        raise EnrollmentError(fault, code="join.malformed")
    token = JoinToken.objects.select_for_update(no_key=True).filter(pk=ask.token_id).first()
    if token is None or not is_secret(ask.secret, token.secret_hash):
        raise EnrollmentError(_REFUSED, code="join.no_token")
    key = authority.requested_key(ask.csr)
    asked = JoinRequest.objects.filter(token=token).first()
    if asked is not None and asked.public_key == key:
        JoinRequest.objects.filter(pk=asked.pk).update(seen_at=now())
        return asked
    if asked is not None or token.withdrawn_at is not None or token.expires_at <= now():
        raise EnrollmentError(_REFUSED, code="join.no_token")
    if selectors.is_key_known(key):
        raise EnrollmentError("this key was used before: make another", code="join.known_key")
    return _new_request(token, ask, key, address)


def _new_request(token: JoinToken, ask: JoinAsk, key: str, address: str) -> JoinRequest:
    token.used_at = now()
    token.save(update_fields=["used_at"])
    name = token.name or ask.name
    hosts = EdgeHost.objects.filter(lab=token.lab).values_list("id", "key", "machine_id")
    known_id = find_known(hosts, key=key_of_name(name), machine_id=ask.machine_id)
    row = JoinRequest.objects.create(
        lab=token.lab,
        token=token,
        name=name,
        csr=ask.csr,
        public_key=key,
        machine_id=ask.machine_id,
        facts=dict(ask.facts),
        address=address,
        known_host_id=known_id,
        asked_at=now(),
        seen_at=now(),
    )
    detail = {"name": name, "address": address, "public_key": key}
    account_services.write_audit("host.asked", str(row.id), actor=None, detail=detail)
    if known_id is not None:
        _suspend(known_id, row)
    on_commit(partial(feed.publish, "hosts", {"join_id": str(row.id)}))
    return row


def _suspend(host_id: UUID, request: JoinRequest) -> None:
    host = selectors.host_for_update(host_id)
    if host.suspended_at is not None:
        return
    host.suspended_at = now()
    host.save(update_fields=["suspended_at"])
    account_services.write_audit(
        "host.suspended",
        str(host.id),
        actor=None,
        reason="a machine with another key says that it is this host",
        detail={"join_id": str(request.id)},
    )
    on_commit(partial(feed.publish, "hosts", {"host_id": str(host.id)}))


def answer_to(request: JoinRequest) -> JoinWaiting | AdmittedHost | Refuse:
    """Return what the machine is told."""
    if request.state == JoinRequest.State.REJECTED:
        text = f"an admin rejected this machine: {request.reason}"
        return Refuse(code="join.rejected", message=text)
    if request.state == JoinRequest.State.WAITING:
        if selectors.is_stale(request):
            text = "nobody answered in time: ask again with another token"
            return Refuse(code="join.expired", message=text)
        return JoinWaiting(code=selectors.code_of_request(request))
    certificate = HostCertificate.objects.filter(
        host=request.host_id, public_key=request.public_key, ended_at__isnull=True
    ).first()
    if certificate is None or request.host is None:
        return Refuse(code="host.revoked", message="this host's key was revoked")
    return AdmittedHost(
        host_id=request.host.id, name=request.host.name, certificate=certificate.pem
    )


def admit_request(request_id: UUID, *, typed: str, reason: str, actor: User) -> EdgeHost:
    """Make a host of a machine whose code an admin has typed as the machine shows it.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: The actor may not admit hosts.
        DefinitionError: No reason was given.
        EnrollmentError: The code differs: something may sit in between. That is on record.
        StateError: It was answered, nobody waits any more, or the host that it claims to be
            has a key that lives.

    Effect:
        None on matter. The machine gets a certificate for 90 days. One that takes a known
        host's place begins with a new journal and inherits no lock.
    """
    row = selectors.find_request(request_id)
    require_admission(actor, row.lab)
    refuse_no_reason(reason, "say what you checked", code="host.no_reason")
    if not is_code(typed, selectors.code_of_request(row)):
        with atomic():
            account_services.write_audit(
                "host.code_differs", str(row.id), actor=actor, reason=reason
            )
        raise EnrollmentError(
            "the code differs: do not admit. Something may sit between you and this machine",
            code="join.code_differs",
        )
    return _admit(request_id, reason, actor)


@atomic
def _admit(request_id: UUID, reason: str, actor: User) -> EdgeHost:
    row = _undecided(request_id, actor, reason)
    if selectors.is_stale(row):
        raise StateError("it has waited for more than a day: let it ask again", code="join.expired")
    host = _new_host(row) if row.known_host_id is None else _renewed_host(row.known_host_id, row)
    keep_certificate(host, row.csr)
    row.host = host
    _decide(row, JoinRequest.State.ADMITTED, actor, reason)
    detail = {"host_id": str(host.id), "public_key": row.public_key}
    account_services.write_audit(
        "host.admit",
        str(host.id),
        actor=actor,
        reason=reason,
        detail=detail,
        meaning="admits the machine whose code was typed as a host of the lab",
    )
    on_commit(partial(feed.publish, "hosts", {"host_id": str(host.id)}))
    return host


def _new_host(row: JoinRequest) -> EdgeHost:
    key = key_of_name(row.name)
    if EdgeHost.objects.filter(lab=row.lab, key=key).exists():
        raise StateError(f"there is a host {key} by now: let it ask again", code="join.name_taken")
    return EdgeHost.objects.create(
        id=new_id(),
        lab=row.lab,
        key=key,
        name=row.name,
        public_key=row.public_key,
        machine_id=row.machine_id,
        has_broker=False,
    )


def _renewed_host(host_id: UUID, row: JoinRequest) -> EdgeHost:
    host = selectors.host_for_update(host_id)
    if host.state not in {*CLOSED, SessionState.REVOKED.value}:
        text = f"the key of {host.name} lives: revoke it first, which ends what it was given"
        raise StateError(text, code="host.key_lives")
    host.certificates.filter(ended_at__isnull=True).update(ended_at=now())
    keep_record(host, readmitted(record_of(host)))
    host.public_key, host.machine_id = row.public_key, row.machine_id
    host.state, host.state_at = SessionState.ENROLLING.value, now()
    host.suspended_at, host.heartbeat, host.has_broker = None, {}, False
    host.save()
    return host


@atomic
def reject_request(request_id: UUID, *, reason: str, actor: User) -> JoinRequest:
    """Send a machine away for good: its key never asks again.

    Raises:
        NotFoundError: There is none.
        ForbiddenError: The actor may not admit hosts.
        DefinitionError: No reason was given.
        StateError: It was answered before.

    Effect:
        None on matter. A host that the machine claimed to be goes on as before.
    """
    row = _undecided(request_id, actor, reason)
    _decide(row, JoinRequest.State.REJECTED, actor, reason)
    account_services.write_audit("host.reject", str(row.id), actor=actor, reason=reason)
    waiting = JoinRequest.objects.filter(
        known_host=row.known_host_id, state=JoinRequest.State.WAITING
    )
    if row.known_host_id is not None and not waiting.exists():
        EdgeHost.objects.filter(pk=row.known_host_id).update(suspended_at=None)
        on_commit(partial(feed.publish, "hosts", {"host_id": str(row.known_host_id)}))
    return row


def _undecided(request_id: UUID, actor: User, reason: str) -> JoinRequest:
    row = selectors.request_for_update(request_id)
    require_admission(actor, row.lab)
    refuse_no_reason(reason, "say what you checked", code="host.no_reason")
    if row.state != JoinRequest.State.WAITING:
        raise StateError(f"{row.name} was {row.state} before", code="join.answered")
    return row


def _decide(row: JoinRequest, state: JoinRequest.State, actor: User, reason: str) -> None:
    row.state, row.reason = state, reason
    row.decided_by, row.decided_at = actor, now()
    row.save()
    on_commit(partial(feed.send, join_group(row.id), {"type": "join.decided"}))
