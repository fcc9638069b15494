"""Tokens, machines that ask, the code that an admin types, certificates and their end."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from uuid import UUID, uuid4

import msgspec
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from pytest_django import Settings

from labweb.accounts.models import AuditEntry
from labweb.common.clock import now
from labweb.common.signatures import authority
from labweb.domain.enrollment.host_join import (
    AdmittedHost,
    JoinAsk,
    JoinWaiting,
    code_of,
    parse_token,
)
from labweb.domain.errors import DefinitionError, EnrollmentError, ForbiddenError, StateError
from labweb.domain.messages.session import Refuse
from labweb.enrollment import selectors, services
from labweb.enrollment.models import EdgeHost, HostCertificate, JoinRequest, JoinToken
from labweb.fleet.services import fencing
from labweb.runs import services as run_services
from tests.builders import Bench, Edge, a_started_run, an_edge, dispatched
from workers.base.host_key import HostKey
from workers.enrollment.host_identity import signing_request


@pytest.fixture(autouse=True)
def _own_authority(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


def a_key() -> HostKey:
    return HostKey(Ed25519PrivateKey.generate())


def a_token(bench: Bench, name: str = "") -> str:
    return services.make_token(bench.lab, actor=bench.people["admin"], name=name).text


def ask_with(token: str, key: HostKey, **fields: object) -> JoinAsk:
    read = parse_token(token)
    ask = JoinAsk(
        token_id=read.token_id, secret=read.secret, csr=signing_request(key), name="Bench 2"
    )
    return msgspec.structs.replace(ask, **fields)


def typed(key: HostKey) -> str:
    return code_of(authority.authority_hash(), key.public_raw)


def admitted(bench: Bench, key: HostKey, **fields: object) -> EdgeHost:
    request = services.take_request(ask_with(a_token(bench), key, **fields))
    return services.admit_request(
        request.id, typed=typed(key), reason="stood there", actor=bench.people["admin"]
    )


def shown(host: EdgeHost, public_key: str) -> bytes:
    row = HostCertificate.objects.get(host=host, public_key=public_key)
    certificate = x509.load_pem_x509_certificate(row.pem.encode())
    return certificate.public_bytes(serialization.Encoding.DER)


def an_edge_of(bench: Bench, host: EdgeHost, key: HostKey) -> Edge:
    edge = Edge(bench, key.private)
    edge.host_id = host.id
    return edge


def test_a_token_names_the_authority_and_leaves_only_a_hash(bench: Bench) -> None:
    token = parse_token(a_token(bench))
    assert token.ca_hash == authority.authority_hash()
    row = JoinToken.objects.get(pk=token.token_id)
    assert token.secret not in str(vars(row))
    assert row.expires_at - row.created_at == timedelta(minutes=15)
    assert AuditEntry.objects.filter(action="host.token_made").count() == 1


@pytest.mark.parametrize("lifetime_s", [0.0, -1.0, 3601.0, float("nan"), float("inf")])
def test_a_token_lives_for_an_hour_at_most(bench: Bench, lifetime_s: float) -> None:
    with pytest.raises(DefinitionError):
        services.make_token(bench.lab, actor=bench.people["admin"], lifetime_s=lifetime_s)
    assert not JoinToken.objects.exists()


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_only_an_admin_makes_tokens_and_answers(bench: Bench, role: str) -> None:
    key = a_key()
    request = services.take_request(ask_with(a_token(bench), key))
    actor = bench.people[role]
    with pytest.raises(ForbiddenError):
        services.make_token(bench.lab, actor=actor)
    with pytest.raises(ForbiddenError):
        services.admit_request(request.id, typed=typed(key), reason="mine", actor=actor)
    with pytest.raises(ForbiddenError):
        services.reject_request(request.id, reason="mine", actor=actor)
    assert selectors.find_request(request.id).state == "waiting"


def test_a_machine_waits_until_its_code_is_typed_and_then_has_a_certificate(bench: Bench) -> None:
    key = a_key()
    request = services.take_request(ask_with(a_token(bench), key))
    waiting = services.answer_to(request)
    assert waiting == JoinWaiting(code=typed(key))
    host = services.admit_request(
        request.id, typed=typed(key), reason="stood there", actor=bench.people["admin"]
    )
    answer = services.answer_to(selectors.find_request(request.id))
    assert isinstance(answer, AdmittedHost)
    assert (answer.host_id, host.key, host.state) == (host.id, "bench_2", "enrolling")
    row = HostCertificate.objects.get(host=host)
    assert timedelta(days=89) < row.not_after - now() <= timedelta(days=90)
    steps = list(AuditEntry.objects.order_by("id").values_list("action", flat=True))
    assert steps[-3:] == ["host.token_made", "host.asked", "host.admit"]


def test_a_wrong_code_admits_nobody_and_is_on_record(bench: Bench) -> None:
    request = services.take_request(ask_with(a_token(bench), a_key()))
    with pytest.raises(EnrollmentError) as refusal:
        services.admit_request(
            request.id, typed=typed(a_key()), reason="looks ok", actor=bench.people["admin"]
        )
    assert refusal.value.code == "join.code_differs"
    assert AuditEntry.objects.get(action="host.code_differs").subject == str(request.id)
    assert selectors.find_request(request.id).state == "waiting"
    assert not HostCertificate.objects.exists()


def test_a_token_is_used_once_but_by_the_same_key_again(bench: Bench) -> None:
    token, key = a_token(bench), a_key()
    first = services.take_request(ask_with(token, key))
    assert services.take_request(ask_with(token, key)).pk == first.pk
    with pytest.raises(EnrollmentError) as refusal:
        services.take_request(ask_with(token, a_key()))
    assert refusal.value.code == "join.no_token"
    assert JoinRequest.objects.count() == 1


def test_an_old_a_withdrawn_and_a_guessed_token_open_nothing(bench: Bench) -> None:
    old, withdrawn, guessed = (a_token(bench) for _ in range(3))
    JoinToken.objects.filter(pk=parse_token(old).token_id).update(expires_at=now())
    services.withdraw_token(parse_token(withdrawn).token_id, actor=bench.people["admin"])
    asks = [
        ask_with(old, a_key()),
        ask_with(withdrawn, a_key()),
        ask_with(guessed, a_key(), secret="0" * 32),
        ask_with(guessed, a_key(), token_id=uuid4()),
    ]
    for ask in asks:
        with pytest.raises(EnrollmentError) as refusal:
            services.take_request(ask)
        assert refusal.value.code == "join.no_token"
    assert not JoinRequest.objects.exists()


def another_csr() -> str:
    name = x509.Name([])
    request = x509.CertificateSigningRequestBuilder().subject_name(name)
    key = generate_private_key(SECP256R1())
    signed = request.sign(key, __import__("cryptography").hazmat.primitives.hashes.SHA256())
    return signed.public_bytes(serialization.Encoding.PEM).decode()


@pytest.mark.parametrize(
    "fields",
    [
        {"csr": "no request"},
        {"csr": another_csr()},
        {"csr": "x" * 5000},
        {"name": ""},
        {"name": "−−"},
        {"name": "a\nb"},
        {"name": "x" * 101},
        {"facts": {str(number): "" for number in range(17)}},
        {"facts": {"a": "x" * 201}},
        {"machine_id": "x" * 201},
        {"machine_id": "a\x1b[2J"},
        {"name": "Bench\u202e 1"},
        {"name": "Bench\u3164 1"},
        {"facts": {"system": "Linux\u2066"}},
        {"facts": {"a\nb": "x"}},
    ],
)
def test_a_malformed_request_uses_no_token_up(bench: Bench, fields: dict[str, object]) -> None:
    token = a_token(bench)
    with pytest.raises(EnrollmentError):
        services.take_request(ask_with(token, a_key(), **fields))
    services.take_request(ask_with(token, a_key()))


def test_a_rejected_machine_is_told_why_and_its_key_never_asks_again(bench: Bench) -> None:
    key = a_key()
    request = services.take_request(ask_with(a_token(bench), key))
    services.reject_request(request.id, reason="nobody knows it", actor=bench.people["admin"])
    answer = services.answer_to(selectors.find_request(request.id))
    assert isinstance(answer, Refuse)
    assert "nobody knows it" in answer.message
    with pytest.raises(EnrollmentError) as refusal:
        services.take_request(ask_with(a_token(bench), key))
    assert refusal.value.code == "join.known_key"
    with pytest.raises(StateError):
        services.admit_request(
            request.id, typed=typed(key), reason="after all", actor=bench.people["admin"]
        )


def test_nobody_is_admitted_who_has_waited_for_a_day(bench: Bench) -> None:
    key = a_key()
    request = services.take_request(ask_with(a_token(bench), key))
    JoinRequest.objects.update(asked_at=now() - timedelta(days=1, seconds=1))
    assert isinstance(services.answer_to(selectors.find_request(request.id)), Refuse)
    with pytest.raises(StateError) as refusal:
        services.admit_request(
            request.id, typed=typed(key), reason="late", actor=bench.people["admin"]
        )
    assert refusal.value.code == "join.expired"


def test_a_host_speaks_only_with_its_own_living_certificate(bench: Bench) -> None:
    key, other = a_key(), a_key()
    host = admitted(bench, key)
    stranger = admitted(bench, other, name="Bench 3")
    edge = an_edge_of(bench, host, key)
    for der, code in (
        (None, "host.no_certificate"),
        (shown(stranger, other.public_base64), "host.other_certificate"),
    ):
        with pytest.raises(EnrollmentError) as refusal:
            services.open_session(edge.hello("n"), "n", der)
        assert refusal.value.code == code
    stolen = an_edge_of(bench, host, other)
    with pytest.raises(EnrollmentError) as forged:
        services.open_session(stolen.hello("n"), "n", shown(host, key.public_base64))
    assert forged.value.code == "host.bad_signature"
    der = shown(host, key.public_base64)
    assert services.open_session(edge.hello("n"), "n", der).mode == "normal"
    HostCertificate.objects.filter(host=host).update(not_after=now())
    with pytest.raises(EnrollmentError) as late:
        services.open_session(edge.hello("n"), "n", der)
    assert late.value.code == "host.certificate_over"


def test_both_certificates_are_good_until_the_next_has_opened_a_session(bench: Bench) -> None:
    key, following = a_key(), a_key()
    host = admitted(bench, key)
    edge = an_edge_of(bench, host, key)
    epoch = services.open_session(edge.hello("n"), "n", shown(host, key.public_base64)).epoch
    csr = signing_request(following)
    row = services.renew_certificate(host.id, epoch, csr)
    assert services.renew_certificate(host.id, epoch, csr).pk == row.pk, "asked again"
    services.close_session(host.id, epoch)
    again = services.open_session(
        edge.hello("n", epoch_last=epoch), "n", shown(host, key.public_base64)
    )
    services.close_session(host.id, again.epoch)
    moved = an_edge_of(bench, host, following)
    moved.journal_id = edge.journal_id
    newer = services.open_session(
        moved.hello("n", epoch_last=again.epoch), "n", shown(host, following.public_base64)
    )
    assert newer.mode == "normal"
    with pytest.raises(EnrollmentError) as over:
        services.open_session(edge.hello("n"), "n", shown(host, key.public_base64))
    assert over.value.code == "host.certificate_over"


def test_a_session_that_is_over_gets_no_certificate(bench: Bench) -> None:
    key = a_key()
    host = admitted(bench, key)
    der = shown(host, key.public_base64)
    epoch = services.open_session(an_edge_of(bench, host, key).hello("n"), "n", der).epoch
    with pytest.raises(EnrollmentError):
        services.renew_certificate(host.id, epoch - 1, signing_request(a_key()))
    services.revoke_host(host.id, actor=bench.people["admin"], reason="stolen")
    with pytest.raises(EnrollmentError):
        services.renew_certificate(host.id, epoch, signing_request(a_key()))
    with pytest.raises(EnrollmentError) as refusal:
        services.open_session(an_edge_of(bench, host, key).hello("n"), "n", der)
    assert refusal.value.code == "host.revoked"


@pytest.mark.parametrize("fields", [{"name": "Bench 1"}, {"machine_id": "m", "name": "New"}])
def test_a_known_host_with_another_key_is_suspended_and_a_person_is_asked(
    bench: Bench, fields: dict[str, str]
) -> None:
    edge = an_edge(bench)
    EdgeHost.objects.filter(pk=edge.host_id).update(machine_id="m", key="bench_1")
    run = a_started_run(bench)
    key = a_key()
    request = services.take_request(ask_with(a_token(bench), key, **fields))
    assert request.known_host_id == edge.host_id
    host = selectors.find_host(edge.host_id)
    assert host is not None
    assert host.suspended_at is not None
    assert run_services.dispatch_ready() == 0, "it gets nothing new"
    assert AuditEntry.objects.filter(action="host.suspended").count() == 1
    with pytest.raises(StateError) as refusal:
        services.admit_request(
            request.id, typed=typed(key), reason="new disk", actor=bench.people["admin"]
        )
    assert refusal.value.code == "host.key_lives"
    services.reject_request(request.id, reason="not ours", actor=bench.people["admin"])
    assert run_services.dispatch_ready() > 0, run.state


def test_a_machine_with_another_key_takes_its_place_once_the_old_key_is_revoked(
    bench: Bench,
) -> None:
    edge = an_edge(bench)
    EdgeHost.objects.filter(pk=edge.host_id).update(machine_id="m")
    key, admin = a_key(), bench.people["admin"]
    request = services.take_request(ask_with(a_token(bench), key, machine_id="m"))
    fencing.revoke_host(edge.host_id, actor=admin, reason="its disk is gone")
    host = services.admit_request(request.id, typed=typed(key), reason="new disk", actor=admin)
    assert host.pk == edge.host_id
    assert (host.journal_id, host.suspended_at, host.state) == (None, None, "enrolling")
    renewed = an_edge_of(bench, host, key)
    der = shown(host, key.public_base64)
    assert services.open_session(renewed.hello("n"), "n", der).mode == "normal"
    with pytest.raises(EnrollmentError):
        services.open_session(edge.hello("n"), "n")


def test_a_host_with_work_is_revoked_at_once_when_that_is_said(bench: Bench) -> None:
    run = a_started_run(bench)
    edge = an_edge(bench)
    attempt = dispatched(run)
    admin = bench.people["admin"]
    with pytest.raises(StateError) as busy:
        fencing.revoke_host(edge.host_id, actor=admin, reason="stolen")
    assert (busy.value.code, busy.value.context["jobs_count"]) == ("host.in_flight", 1)
    fencing.revoke_host(edge.host_id, actor=admin, reason="stolen", with_work=True)
    attempt.job.refresh_from_db()
    assert (attempt.job.state, attempt.job.code) == ("in_doubt", "host.revoked")
    assert not services.is_session_open(edge.host_id, edge.epoch)
    assert edge.report("accepted", attempt.id) is None
    assert UUID(str(bench.host.id)) == edge.host_id


def test_the_authority_is_refused_when_others_can_read_it(tmp_path: Path) -> None:
    authority.authority_pem()
    authority._load.cache_clear()
    authority.authority_path().chmod(0o644)
    with pytest.raises(EnrollmentError) as refusal:
        authority.authority_pem()
    assert refusal.value.code == "ca.unusable"
