"""What the journal promises, and what shows when somebody breaks it."""

from __future__ import annotations

import shutil
import sqlite3
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from uuid import uuid4

import pytest

from labweb.domain.messages.events import event_hash
from labweb.domain.runs.host_journal.action_states import ActionState
from labweb.domain.runs.host_journal.journal_rows import JournalError
from tests.workers.bench import DEVICE_ID, HOST_ID, Host, a_do
from workers.base.host_key import create_key
from workers.journal import journal_file, journal_schema
from workers.journal.journal import Journal, check_journal, create_journal
from workers.journal.journal_file import LOG_PAGES
from workers.journal.journal_witness import read_seal
from workers.uplink.session import arm, disarm_if_regressed, make_hello, record_ack, record_boot


@pytest.fixture
def host(tmp_path: Path) -> Host:
    return Host(tmp_path / "host", "tcp://127.0.0.1:9")


def test_a_commit_reaches_the_disk(host: Host) -> None:
    pragma = {
        name: host.journal._connection.execute(f"PRAGMA {name}").fetchone()[0]
        for name in ("journal_mode", "synchronous", "busy_timeout")
    }
    assert pragma == {"journal_mode": "wal", "synchronous": 2, "busy_timeout": 5000}


def test_the_journal_is_for_its_owner_alone(host: Host) -> None:
    assert host.path.stat().st_mode & 0o077 == 0


def test_a_write_that_fails_leaves_neither_row_nor_event(host: Host) -> None:
    before = host.kinds()

    def write() -> None:
        with host.journal.write() as tx:
            tx.set_meta("epoch", "99")
            tx.append("boot", None, {"x": 1 // 0})

    with pytest.raises(ZeroDivisionError):
        write()
    assert host.journal.host_state().epoch == 1
    assert host.kinds() == before


def test_a_null_character_of_a_device_is_written_as_a_sign_that_the_server_can_keep(
    host: Host,
) -> None:
    with host.journal.write() as tx:
        tx.append("boot", None, {"told": ["A\0", {"B\0": "\\u0000"}]})
    (event,) = [one for one in host.journal.events_after(0) if "told" in one.body]
    assert event.body == {"told": ["A␀", {"B␀": "\\u0000"}]}
    assert event.hash == event_hash(host.journal.journal_id, event.prev_hash, event)


def test_only_one_of_two_takes_an_action_from_one_state_to_the_next(host: Host) -> None:
    do = a_do(host.server)
    host.take(do)
    other = Journal(host.path)
    with other.write() as tx:
        tx.move(do.action_id, ActionState.ACCEPTED, ActionState.STARTED)
    with pytest.raises(JournalError, match="is not accepted"), host.journal.write() as tx:
        tx.move(do.action_id, ActionState.ACCEPTED, ActionState.STARTED)
    other.close()


def test_a_journal_put_back_from_a_copy_is_seen_and_never_armed(host: Host) -> None:
    host.journal._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    copy = host.path.with_name("copy")
    shutil.copy(host.path, copy)
    host.take(a_do(host.server))
    host.journal.close()
    for name in ("journal.sqlite3-wal", "journal.sqlite3-shm"):
        host.path.with_name(name).unlink(missing_ok=True)
    shutil.copy(copy, host.path)
    restored = Journal(host.path)
    assert restored.host_state().armed_boot_id is not None
    assert "the seal says" in str(disarm_if_regressed(restored))
    assert restored.host_state().armed_boot_id is None
    assert not arm(restored)
    assert make_hello(restored, create_key(host.folder / "key"), "n").seal_seq == 2
    restored.close()


def test_another_history_of_the_same_length_is_seen(host: Host) -> None:
    seal = read_seal(host.path.with_suffix(".seal"))
    assert seal is not None
    host.journal._connection.execute("UPDATE event SET hash = 'other' WHERE seq = ?", (seal.seq,))
    assert "is not the one that was sealed" in str(host.journal.regression())


def test_every_write_is_durable_but_the_one_that_says_otherwise(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    def synchronous() -> int:
        return int(host.journal._connection.execute("PRAGMA synchronous").fetchone()[0])

    with host.journal.write(is_durable=False) as tx:
        tx.set_meta("acked_seq", "0")
        assert synchronous() == 1
    assert synchronous() == 2
    other = Journal(host.path)
    other._connection.execute("BEGIN IMMEDIATE")
    monkeypatch.setattr(journal_file, "BUSY_TIMEOUT_S", 0.01)
    with pytest.raises(JournalError), host.journal.write(is_durable=False):
        pass
    other.close()
    with pytest.raises(ZeroDivisionError), host.journal.write(is_durable=False):
        _ = 1 // 0
    assert synchronous() == 2


def test_a_write_begins_soon_after_the_one_it_waits_for(host: Host) -> None:
    looks: list[str] = []
    host.journal._connection.set_trace_callback(looks.append)
    is_held = threading.Event()

    def hold() -> None:
        other = Journal(host.path)
        with other.write() as tx:
            tx.append("boot", None, {})
            is_held.set()
            while looks.count("BEGIN IMMEDIATE") < 3:
                time.sleep(0.001)
        other.close()

    with ThreadPoolExecutor() as pool:
        held = pool.submit(hold)
        assert is_held.wait(5)
        with host.journal.write() as tx:
            tx.append("boot", None, {})
        held.result()
    assert host.journal._connection.execute("PRAGMA busy_timeout").fetchone()[0] == 5000


def test_the_log_has_its_length_at_once_and_nothing_else_is_left_behind(host: Host) -> None:
    do = a_do(host.server)
    host.take(do)
    before = (host.journal.head(), _tables(host.journal), host.path.read_bytes())
    log = host.path.with_name("journal.sqlite3-wal")
    assert log.stat().st_size < 200_000
    host.journal.lengthen_log()
    length_bytes = log.stat().st_size
    assert length_bytes > LOG_PAGES * 4096
    assert (host.journal.head(), _tables(host.journal), host.path.read_bytes()) == before
    with host.journal.write() as tx:
        tx.move(do.action_id, ActionState.ACCEPTED, ActionState.STARTED)
    host.journal.lengthen_log()
    assert log.stat().st_size == length_bytes


def test_a_log_that_has_its_length_is_read_after_a_power_cut(host: Host, tmp_path: Path) -> None:
    host.journal.lengthen_log()
    do = a_do(host.server)
    host.take(do)
    cut = tmp_path / "cut"
    cut.mkdir()
    for name in ("journal.sqlite3", "journal.sqlite3-wal", "journal.seal"):
        shutil.copy(host.path.with_name(name), cut / name)
    check_journal(cut / "journal.sqlite3")
    found = Journal(cut / "journal.sqlite3")
    assert found.head() == host.journal.head()
    assert found.state_of(do.action_id) is ActionState.ACCEPTED
    assert _tables(found) == _tables(host.journal)
    found.close()


def test_a_log_that_finds_no_room_leaves_the_journal_as_it_was(host: Host) -> None:
    before = (host.journal.head(), _tables(host.journal))
    host.journal._connection.execute("PRAGMA max_page_count = 100")
    with pytest.raises(JournalError, match="full"):
        host.journal.lengthen_log()
    assert (host.journal.head(), _tables(host.journal)) == before
    host.take(a_do(host.server))


def _tables(journal: Journal) -> list[str]:
    rows = journal._connection.execute("SELECT name FROM sqlite_master ORDER BY name")
    return [row[0] for row in rows]


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite3"
    create_journal(path, HOST_ID)
    text = bytearray(path.read_bytes())
    text[4096:8192] = b"\x5a" * 4096
    path.write_bytes(text)
    with pytest.raises(JournalError):
        check_journal(path)
    path.write_bytes(b"no database at all, but long enough to be read as one" * 100)
    with pytest.raises(JournalError):
        check_journal(path)


def test_the_journal_of_another_host_or_a_newer_program_is_refused(host: Host) -> None:
    with pytest.raises(JournalError, match="belongs to host"):
        create_journal(host.path, uuid4())
    host.journal._connection.execute("PRAGMA user_version = 99")
    with pytest.raises(JournalError, match="install the newer program"):
        Journal(host.path)


def test_tables_do_not_change_while_an_action_is_open(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    do = a_do(host.server)
    host.take(do)
    changed = (*journal_schema.MIGRATIONS, "ALTER TABLE meta ADD COLUMN note TEXT")
    monkeypatch.setattr(journal_schema, "MIGRATIONS", changed)
    with pytest.raises(JournalError, match="1 actions are open"):
        Journal(host.path)
    with host.journal.write() as tx:
        tx.move(do.action_id, ActionState.ACCEPTED, ActionState.STOPPED)
    Journal(host.path).close()
    columns = sqlite3.connect(host.path).execute("PRAGMA table_info(meta)").fetchall()
    assert [column[1] for column in columns] == ["key", "value", "note"]


def test_a_start_of_the_machine_is_told_once_and_has_to_be_armed_anew(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    record_boot(host.journal)
    record_boot(host.journal)
    assert host.kinds() == ["armed", "boot"]
    monkeypatch.setenv("LABWEB_BOOT_ID", "next")
    later = Journal(host.path)
    state = later.host_state()
    assert state.armed_boot_id not in {None, state.boot_id}
    record_boot(later)
    assert arm(later)
    assert host.kinds() == ["armed", "boot", "boot", "armed"]
    later.close()


def test_events_are_deleted_only_when_acknowledged_and_old(host: Host) -> None:
    for _ in range(3):
        host.take(a_do(host.server, resources=[]))
    head = host.journal.head()
    record_ack(host.journal, 2)
    assert host.journal.prune(3600.0) == 0
    assert host.journal.prune(-1.0) == 2
    assert [one.seq for one in host.journal.events_after(0)] == [3, 4]
    record_ack(host.journal, 99)
    assert host.journal.acked_seq() == head[0]
    assert host.journal.prune(-1.0) == 1
    assert host.journal.head() == head


def test_a_frame_of_events_stays_within_its_size(host: Host) -> None:
    with host.journal.write() as tx:
        for _ in range(20):
            tx.append("boot", None, {"text": "x" * 50_000})
    frame = host.journal.events_after(1)
    assert 1 <= len(frame) <= 5
    with host.journal.write() as tx:
        tx.append("boot", None, {"text": "x" * 500_000})
    assert len(host.journal.events_after(21)) == 1


def test_no_question_of_the_journal_reads_the_actions_that_have_ended(host: Host) -> None:
    """They stay for ever, and what is asked each second or each step must not grow with them."""
    asked: list[str] = []
    host.take(a_do(host.server))
    host.journal._connection.set_trace_callback(asked.append)
    host.journal.open_ids()
    host.journal.open_count()
    host.journal.has_accepted()
    host.journal.waiting_lines()
    host.journal.next_of(host.line, 2)
    host.journal.is_line_acting(host.line)
    host.journal.actions(host.line, ActionState.ACCEPTED, limit_count=4)
    host.journal.actions(host.line, ActionState.ACTUATED)
    host.journal.blocked_by(DEVICE_ID)
    with host.journal.write() as tx:
        tx.open_rows()
        tx.blocked_by(DEVICE_ID)
    host.journal._connection.set_trace_callback(None)
    questions = [query for query in asked if "FROM action" in query]
    assert len(questions) == 11
    for query in questions:
        plan = host.journal._connection.execute(f"EXPLAIN QUERY PLAN {query}").fetchall()
        steps = [str(row["detail"]) for row in plan]
        assert "UNION ALL" not in query or "USE TEMP B-TREE FOR ORDER BY" not in steps
        assert all("SCAN action" not in one or "action_waits" in one for one in steps), query


def test_an_older_journal_gets_its_indexes(host: Host) -> None:
    host.take(a_do(host.server))
    older = "DROP INDEX action_waits; CREATE INDEX action_open ON action (line, st, dseq)"
    host.journal._connection.executescript(older)
    host.journal.close()
    host.journal = Journal(host.path)
    query = "SELECT name FROM sqlite_master WHERE type = 'index' AND name LIKE 'action_%'"
    rows = host.journal._connection.execute(query)
    assert {row["name"] for row in rows} == {"action_in_doubt", "action_waits"}
    host.take(a_do(host.server, resources=[]))
    assert host.journal.open_count() == 2
