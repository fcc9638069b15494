"""A host countersigns the heads of the server's record, and prints what it keeps."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import msgspec
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from labweb.domain.canonical_json import canonical
from labweb.domain.messages.chain_heads import ChainHead, Countersigned, Heads, countersigned_bytes
from labweb.domain.messages.devices_and_drivers import Signed
from tests.workers.bench import Host
from workers.base.host_key import HostKey, create_key
from workers.base.signatures import is_signature
from workers.journal import countersigned_heads
from workers.uplink.session import countersign

RECORD_KEY = Ed25519PrivateKey.generate()
PUBLIC = base64.b64encode(RECORD_KEY.public_key().public_bytes_raw()).decode()


def signed(seq: int, *, key: Ed25519PrivateKey = RECORD_KEY) -> Signed:
    head = ChainHead(chain="audit", seq=seq, hash=f"{seq:x}", at="2026-11-26T20:00:00+00:00")
    body = canonical(head)
    return Signed(
        body=body.decode(), key_id="r", signature=base64.b64encode(key.sign(body)).decode()
    )


@pytest.fixture
def host(tmp_path: Path) -> Host:
    return Host(tmp_path / "host", "tcp://127.0.0.1:9")


@pytest.fixture
def key(tmp_path: Path) -> HostKey:
    return create_key(tmp_path / "host.key")


def test_a_host_signs_the_head_with_its_own_key(host: Host, key: HostKey) -> None:
    one = signed(7)
    countersign(host.journal, key, Heads(key=PUBLIC, signed=[one]))
    event = host.events()[-1]
    assert (event.kind, event.body["seq"]) == ("countersigned", 7)
    message = countersigned_bytes(PUBLIC, one)
    assert is_signature(key.public_base64, message, event.body["countersignature"])


def test_a_head_that_bears_no_signature_of_its_key_is_not_kept(host: Host, key: HostKey) -> None:
    count = len(host.events())
    forged = signed(7, key=Ed25519PrivateKey.generate())
    countersign(host.journal, key, Heads(key=PUBLIC, signed=[forged]))
    assert len(host.events()) == count


def test_a_record_that_got_shorter_is_told_of(host: Host, key: HostKey) -> None:
    for seq in (7, 5):
        countersign(host.journal, key, Heads(key=PUBLIC, signed=[signed(seq)]))
    assert host.events()[-1].kind == "head_refused"
    assert host.events()[-1].body["code"] == "records.conflict"


def test_what_a_host_keeps_is_printed_as_the_file_that_the_server_reads(
    host: Host, key: HostKey, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    countersign(host.journal, key, Heads(key=PUBLIC, signed=[signed(7)]))
    assert countersigned_heads.print_heads(host.path) == 0
    file = json.loads(capsys.readouterr().out)
    assert (file["format"], file["version"]) == ("labweb heads", 1)
    (kept,) = msgspec.convert(file["heads"], list[Countersigned])
    assert kept.signed == signed(7)


def test_a_journal_that_is_not_there_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert countersigned_heads.print_heads(tmp_path / "none.sqlite3") == 1
    assert "none.sqlite3" in capsys.readouterr().err
