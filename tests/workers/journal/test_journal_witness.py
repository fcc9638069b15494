"""The seal beside the journal: it never goes back, and a copy cannot wipe it out."""

from __future__ import annotations

import shutil
from pathlib import Path
from uuid import uuid4

import msgspec
import pytest

from labweb.domain.runs.host_actions import host_state
from labweb.domain.runs.host_journal.journal_rows import JournalError
from tests.workers.bench import Host, a_do
from workers.base.host_key import create_key
from workers.journal.journal import Journal
from workers.journal.journal_witness import BLOCK_BYTES, PLACES_COUNT, Seal, raise_seal, read_seal
from workers.uplink.session import arm, lose_link, make_hello


@pytest.fixture
def host(tmp_path: Path) -> Host:
    return Host(tmp_path / "host", "tcp://127.0.0.1:9")


def test_the_seal_never_goes_back_and_never_changes_its_journal(host: Host) -> None:
    path = host.path.with_suffix(".seal")
    host.take(a_do(host.server))
    before = read_seal(path)
    journal_id, hash_at = host.journal.journal_id, host.journal._hash_at
    raise_seal(path, Seal(journal_id=journal_id, seq=1, hash="x"), hash_at)
    assert read_seal(path) == before
    with pytest.raises(JournalError):
        raise_seal(path, Seal(journal_id=uuid4(), seq=99, hash="x"), hash_at)
    assert read_seal(path) == before


@pytest.mark.parametrize("place", range(PLACES_COUNT))
def test_a_damaged_place_of_the_seal_leaves_the_other(host: Host, place: int) -> None:
    path = host.path.with_suffix(".seal")
    for _ in range(2):
        host.take(a_do(host.server, resources=[]))
    whole = read_seal(path)
    with path.open("r+b") as stream:
        stream.seek(place * BLOCK_BYTES + 20)
        stream.write(b"\xff" * 8)
    left = read_seal(path)
    assert whole is not None
    assert left is not None
    assert left.seq in {whole.seq, whole.seq - 1}
    assert host.journal.regression() is None
    host.take(a_do(host.server, resources=[]))
    assert read_seal(path) == Seal(journal_id=left.journal_id, seq=whole.seq + 1, hash=_end(host))


def test_a_seal_that_cannot_be_read_or_is_gone_stops_every_write(host: Host) -> None:
    path = host.path.with_suffix(".seal")
    path.write_bytes(b"\0" * BLOCK_BYTES * PLACES_COUNT)
    with pytest.raises(JournalError, match="damaged"):
        host.take(a_do(host.server))
    path.unlink()
    with pytest.raises(JournalError, match="gone"):
        host.take(a_do(host.server, resources=[]))


def test_a_seal_of_one_place_is_read_and_moves_on(host: Host) -> None:
    path = host.path.with_suffix(".seal")
    before = read_seal(path)
    path.write_bytes(msgspec.json.encode(before))
    assert read_seal(path) == before
    host.take(a_do(host.server))
    moved = read_seal(path)
    assert moved is not None
    assert moved.hash == _end(host)


def _end(host: Host) -> str:
    return host.journal.head()[1]


def test_an_answer_leaves_the_seal_to_whoever_tells_it(host: Host) -> None:
    with host.journal.write(is_sealed=False) as tx:
        tx.append("actuated", None, {})
    seal = host.journal.seal()
    assert seal is not None
    assert seal.seq == host.journal.head()[0] - 1
    assert host.journal.regression() is None
    host.journal.seal_up()
    assert host.journal.seal() == Seal(
        journal_id=host.journal.journal_id, seq=seal.seq + 1, hash=_end(host)
    )


def test_the_seal_holds_an_absence_that_a_dead_process_wrote_down(host: Host) -> None:
    with host.journal.write(is_sealed=False) as tx:
        host_state.write_link_lost(tx, host.journal.moment())
    seal = host.journal.seal()
    assert seal is not None
    assert seal.seq < host.journal.head()[0]
    lose_link(host.journal)
    seal = host.journal.seal()
    assert seal is not None
    assert (seal.seq, seal.hash) == host.journal.head()


def test_a_journal_put_back_from_a_copy_cannot_outgrow_its_seal(host: Host) -> None:
    host.journal._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    copy = host.path.with_name("copy")
    shutil.copy(host.path, copy)
    for _ in range(2):
        host.take(a_do(host.server))
    host.journal.close()
    for name in ("journal.sqlite3-wal", "journal.sqlite3-shm"):
        host.path.with_name(name).unlink(missing_ok=True)
    shutil.copy(copy, host.path)
    host.journal = Journal(host.path)
    for _ in range(3):
        host.take(a_do(host.server))
    seal = read_seal(host.path.with_suffix(".seal"))
    assert seal is not None
    assert host.journal.head()[0] > seal.seq
    assert "is not the one that was sealed" in str(host.journal.regression())
    assert not arm(host.journal)
    assert make_hello(host.journal, create_key(host.folder / "key"), "n").regression
    host.journal.close()
