"""Whoever can write to the database cannot write the record again without it being seen."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import StringIO
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from django.conf import settings
from django.core.management import CommandError, call_command
from django.db import connection
from django.db.utils import IntegrityError

from labweb.accounts.models import AuditEntry, SignedHead
from labweb.accounts.selectors.hash_chains import audit_hash
from labweb.approvals.models import ApprovalRequest, Decision
from labweb.approvals.selectors import decision_hash
from labweb.common.signatures import signing
from labweb.crutd.models import Event, EventHead, Ticket
from labweb.crutd.selectors.event_chain import event_hash
from labweb.domain.messages.chain_heads import Heads, countersigned_bytes
from labweb.fleet.services import countersigned_heads
from labweb.runs import services
from tests.builders import HEAT, Bench, Edge, a_started_run, an_edge


@pytest.fixture
def host(bench: Bench) -> Edge:
    return an_edge(bench)


@pytest.fixture
def recorded(bench: Bench, host: Edge) -> Bench:
    """A lab with events, an audit trail and a decision, all signed."""
    host.work_off(a_started_run(bench))
    a_started_run(bench, HEAT)
    services.decide_request(
        ApprovalRequest.objects.get().id,
        actor=bench.people["approver"],
        is_approved=True,
        comment="seen",
    )
    assert countersigned_heads.sign_heads() == 3
    return bench


def run(command: str, *arguments: str) -> tuple[int, str]:
    out = StringIO()
    try:
        call_command(command, *arguments, stdout=out)
    except CommandError as error:
        return error.returncode, out.getvalue()
    return 0, out.getvalue()


@contextmanager
def keys_to_the_database() -> Iterator[None]:
    """Write as its owner: no trigger looks."""
    with connection.cursor() as cursor:
        cursor.execute("SET CONSTRAINTS ALL IMMEDIATE")
        cursor.execute("SET session_replication_role = replica")
        yield
        cursor.execute("SET session_replication_role = origin")


def forge_events() -> None:
    """Edit an event, and hash it and all after it again."""
    rows = list(Event.objects.order_by("seq"))
    prev = ""
    for row in rows:
        if row.seq == 2:
            row.body = {**row.body, "message": "something else"}
        digest = event_hash(prev, row.seq, row.at.isoformat(), str(row.transaction_id), row.body)
        Event.objects.filter(pk=row.pk).update(body=row.body, prev_hash=prev, hash=digest)
        prev = digest
    EventHead.objects.update(hash=prev)


def forge_audit() -> None:
    prev = ""
    for row in AuditEntry.objects.order_by("id"):
        row.reason = f"{row.reason} or so"
        digest = audit_hash(prev, row)
        AuditEntry.objects.filter(pk=row.pk).update(reason=row.reason, prev_hash=prev, hash=digest)
        prev = digest


def forge_decisions() -> None:
    prev = ""
    for row in Decision.objects.order_by("seq"):
        row.is_approved = False
        digest = decision_hash(prev, row)
        Decision.objects.filter(pk=row.pk).update(is_approved=False, prev_hash=prev, hash=digest)
        prev = digest


FORGERIES: dict[str, Callable[[], None]] = {
    "verify_events": forge_events,
    "verify_audit": forge_audit,
    "verify_decisions": forge_decisions,
}


@pytest.mark.parametrize("command", FORGERIES)
def test_a_record_as_it_was_written_is_whole(recorded: Bench, command: str) -> None:
    assert run(command)[0] == 0


@pytest.mark.parametrize(("command", "forge"), FORGERIES.items(), ids=FORGERIES)
def test_a_chain_that_was_hashed_again_does_not_fit_its_signed_head(
    recorded: Bench, command: str, forge: Callable[[], None]
) -> None:
    with keys_to_the_database():
        forge()
    code, text = run(command)
    assert (code, "records.conflict" in text) == (1, True), text


@pytest.mark.parametrize(("command", "forge"), FORGERIES.items(), ids=FORGERIES)
def test_the_file_beside_the_key_outlives_the_heads_in_the_database(
    recorded: Bench, command: str, forge: Callable[[], None]
) -> None:
    with keys_to_the_database():
        forge()
        SignedHead.objects.all().delete()
    assert run(command)[0] == 1


@pytest.mark.parametrize(("command", "forge"), FORGERIES.items(), ids=FORGERIES)
def test_an_exported_file_outlives_the_server(
    recorded: Bench, command: str, forge: Callable[[], None], tmp_path: Path
) -> None:
    kept = tmp_path / "heads.json"
    assert run("export_heads", str(kept))[0] == 0
    with keys_to_the_database():
        forge()
        SignedHead.objects.all().delete()
    (settings.DATA_DIR / "heads.json").unlink()
    assert run(command)[0] == 0
    assert run(command, "--heads", str(kept))[0] == 1


def test_an_edited_entry_of_the_audit_trail_is_named(recorded: Bench) -> None:
    row = AuditEntry.objects.order_by("id")[1]
    with keys_to_the_database():
        AuditEntry.objects.filter(pk=row.pk).update(reason="another")
    code, text = run("verify_audit")
    assert (code, f"audit entry {row.id} was edited" in text) == (1, True)


def test_a_removed_entry_of_the_audit_trail_is_named(recorded: Bench) -> None:
    row = AuditEntry.objects.order_by("id")[1]
    with keys_to_the_database():
        AuditEntry.objects.filter(pk=row.pk).delete()
    code, text = run("verify_audit", "--json")
    assert (code, json.loads(text)["chains"]["audit trail"]["code"]) == (1, "audit.reordered")


def test_an_edited_decision_is_named(recorded: Bench) -> None:
    with keys_to_the_database():
        Decision.objects.update(comment="another")
    assert "decision 1 was edited" in run("verify_decisions")[1]


def test_a_head_signed_with_another_key_is_named(recorded: Bench) -> None:
    key = Ed25519PrivateKey.generate()
    row = SignedHead.objects.get(chain="audit")
    with keys_to_the_database():
        SignedHead.objects.filter(pk=row.pk).update(
            key=b64encode(key.public_key().public_bytes_raw()).decode(),
            signature=b64encode(key.sign(row.body.encode())).decode(),
        )
    assert "records.other_key" in run("verify_audit")[1]


def test_a_chain_that_was_written_again_is_not_signed_and_a_person_is_asked(
    recorded: Bench,
) -> None:
    with keys_to_the_database():
        forge_audit()
    assert countersigned_heads.sign_heads() == 0
    assert countersigned_heads.sign_heads() == 0
    tickets = Ticket.objects.filter(code="records.conflict", detail__chain="audit")
    assert tickets.count() == 1


def test_what_has_not_grown_is_not_signed_again(recorded: Bench) -> None:
    assert countersigned_heads.sign_heads() == 0


GUARDED = (
    "accounts_auditentry",
    "accounts_signedhead",
    "approvals_decision",
    "crutd_entry",
    "crutd_event",
    "crutd_eventhead",
    "crutd_eventsubject",
    "crutd_labbase",
    "runs_hostevent",
)


@pytest.mark.parametrize("table", GUARDED)
def test_no_table_of_the_record_can_be_emptied(db: None, table: str) -> None:
    with connection.cursor() as cursor:
        cursor.execute(f"ALTER TABLE {table} ENABLE TRIGGER {table}_no_truncate")
        with pytest.raises(IntegrityError, match="append-only"):
            cursor.execute(f"TRUNCATE {table} CASCADE")


# --- what hosts say of heads ---


def told(host: Edge, heads: Heads, kind: str = "countersigned", **more: str) -> None:
    """Have a host tell of the first head that it was sent."""
    signed = heads.signed[0]
    own = host.key.sign(countersigned_bytes(heads.key, signed))
    body = {
        **json.loads(signed.body),
        "key": heads.key,
        "signature": signed.signature,
        "countersignature": b64encode(own).decode(),
        **more,
    }
    host.report(kind, None, **body)


def sent() -> Heads:
    heads = countersigned_heads.heads_for_hosts()
    assert heads is not None
    return heads


def test_what_a_host_countersigns_is_exported_with_its_signature(
    recorded: Bench, host: Edge, tmp_path: Path
) -> None:
    told(host, sent())
    run("export_heads", str(tmp_path / "heads.json"))
    found = json.loads((tmp_path / "heads.json").read_bytes())["heads"]
    assert [bool(one["countersignature"]) for one in found].count(True) == 1
    assert not Ticket.objects.exists()


def test_a_head_that_a_host_refuses_is_put_before_a_person(recorded: Bench, host: Edge) -> None:
    told(host, sent(), "head_refused", code="records.conflict", message="shorter")
    assert "shorter" in Ticket.objects.get().message


def test_a_countersignature_of_nobody_is_put_before_a_person(recorded: Bench, host: Edge) -> None:
    told(host, sent(), countersignature=b64encode(bytes(64)).decode())
    assert Ticket.objects.get().code == "records.bad_signature"


def test_the_key_of_the_record_is_in_no_table(recorded: Bench) -> None:
    raw = (settings.DATA_DIR / "record.key").read_text("ascii").splitlines()[1]
    with connection.cursor() as cursor:
        cursor.execute("SELECT string_agg(t::text, '') FROM accounts_signedhead t")
        (text,) = cursor.fetchone()
    assert raw not in text
    assert signing.record_public_key() in text
