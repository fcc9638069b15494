"""What the server makes of a HELLO, of events and of silence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from uuid import UUID

import msgspec
import pytest

from labweb.domain.messages.events import EdgeEvent, event_hash
from labweb.domain.messages.session import Hello
from labweb.domain.runs.host_link.host_session import (
    HostRecord,
    SessionState,
    after_hello,
    check_events,
    decide_hello,
    is_caught_up,
    is_given_up,
    quarantined,
    readmitted,
    state_by_beat,
    state_by_silence,
)

HOST, JOURNAL = UUID(int=1), UUID(int=2)
RECORD = HostRecord(
    host_id=HOST, journal_id=JOURNAL, acked_seq=5, hash_at_acked="h5", epoch=3, last_dseq=7
)
HELLO = Hello(
    host_id=HOST,
    journal_id=JOURNAL,
    boot_id="b",
    armed_boot_id="b",
    epoch_last=3,
    seq_head=5,
    hash_head="h5",
    acked_seq=5,
    seal_seq=5,
)


def chain(count: int) -> list[EdgeEvent]:
    made: list[EdgeEvent] = []
    head = ""
    for seq in range(1, count + 1):
        bare = EdgeEvent(
            seq=seq, prev_hash=head, hash="", kind="boot", action_id=None, at_s=0.0, body={}
        )
        made.append(msgspec.structs.replace(bare, hash=event_hash(JOURNAL, head, bare)))
        head = made[-1].hash
    return made


@pytest.mark.parametrize(
    ("record", "hello", "kind", "code"),
    [
        ({}, {}, "normal", ""),
        ({}, {"seq_head": 9, "hash_head": "h9", "seal_seq": 9}, "normal", ""),
        ({"journal_id": None}, {"journal_id": UUID(int=9)}, "normal", ""),
        ({"is_revoked": True}, {}, "refuse", "host.revoked"),
        ({"quarantine": "host.gap"}, {}, "quarantine", "host.gap"),
        ({}, {"regression": "the seal is gone"}, "quarantine", "host.behind_seal"),
        ({"journal_id": None}, {"regression": "gone"}, "quarantine", "host.behind_seal"),
        ({}, {"journal_id": UUID(int=9)}, "quarantine", "host.other_journal"),
        ({}, {"seq_head": 4, "seal_seq": 4}, "quarantine", "host.journal_regressed"),
        ({}, {"hash_head": "other"}, "quarantine", "host.fork"),
        ({}, {"seal_seq": 6}, "quarantine", "host.behind_seal"),
        ({}, {"epoch_last": 4}, "quarantine", "host.future_epoch"),
        ({"epoch_seen": 3}, {"epoch_last": 2}, "quarantine", "host.epoch_regressed"),
        ({"epoch_seen": 2}, {"epoch_last": 2}, "normal", ""),
    ],
)
def test_a_hello_is_believed_only_where_its_journal_continues_the_known_one(
    record: dict[str, Any], hello: dict[str, Any], kind: str, code: str
) -> None:
    answer = decide_hello(replace(RECORD, **record), msgspec.structs.replace(HELLO, **hello))
    assert (answer.kind, answer.code) == (kind, code)


def test_a_session_has_a_fresh_epoch_and_registers_the_first_journal() -> None:
    record = replace(RECORD, journal_id=None)
    opening = after_hello(record, HELLO, decide_hello(record, HELLO))
    assert (opening.record.epoch, opening.record.journal_id) == (4, JOURNAL)
    assert (opening.state, opening.mode) == (SessionState.SYNCING, "normal")


def test_a_quarantine_voids_all_that_was_given_and_keeps_its_first_cause() -> None:
    once = quarantined(RECORD, "host.gap")
    twice = quarantined(once, "host.fork")
    assert (once.epoch, once.floor, once.quarantine) == (4, 8, "host.gap")
    assert (twice.epoch, twice.floor, twice.quarantine) == (5, 8, "host.gap")
    hello = msgspec.structs.replace(HELLO, hash_head="other")
    opening = after_hello(RECORD, hello, decide_hello(RECORD, hello))
    assert opening.record == quarantined(RECORD, "host.fork")
    assert opening.mode == "quarantine"


def test_a_readmitted_host_begins_at_nothing_above_the_floor() -> None:
    fresh = readmitted(quarantined(RECORD, "host.gap"))
    assert (fresh.journal_id, fresh.acked_seq, fresh.hash_at_acked) == (None, 0, "")
    assert (fresh.epoch, fresh.floor, fresh.quarantine) == (5, 8, "")


def test_the_server_settles_by_itself_only_what_another_journal_has_followed() -> None:
    closed = quarantined(RECORD, "host.gap")
    waiting = readmitted(closed)
    back = replace(waiting, journal_id=UUID(int=9))
    assert [is_given_up(one, 7) for one in (RECORD, closed, waiting, back)] == [
        False,
        False,
        False,
        True,
    ]
    assert not is_given_up(back, 8), "given after the quarantine"


def test_repeats_are_dropped_and_gaps_and_forks_refused() -> None:
    events = chain(4)
    record = replace(RECORD, acked_seq=2, hash_at_acked=events[1].hash)
    assert check_events(record, events).fresh == tuple(events[2:])
    assert check_events(record, events[:2]).fresh == ()
    assert check_events(record, events[3:]).code == "host.gap"
    forged = msgspec.structs.replace(events[2], body={"x": 1})
    assert check_events(record, [forged]).code == "host.fork"
    other = replace(record, hash_at_acked="other")
    assert check_events(other, events).code == "host.fork"
    assert check_events(replace(record, journal_id=None), events).code == "host.no_session"
    assert check_events(quarantined(record, "host.gap"), events).code == "host.quarantined"


def test_a_host_is_caught_up_when_all_it_announced_was_read() -> None:
    assert [is_caught_up(acked, 5) for acked in (4, 5, 6)] == [False, True, True]


@pytest.mark.parametrize(
    ("state", "silent_s", "after"),
    [
        ("online", 9.9, "online"),
        ("online", 10.0, "suspect"),
        ("suspect", 29.9, "suspect"),
        ("syncing", 10.0, "syncing"),
        ("syncing", 30.0, "isolated"),
        ("online", 30.0, "isolated"),
        ("quarantined", 99.0, "quarantined"),
        ("revoked", 99.0, "revoked"),
    ],
)
def test_silence_isolates_a_host_in_two_steps(state: str, silent_s: float, after: str) -> None:
    assert state_by_silence(SessionState(state), silent_s).value == after


@pytest.mark.parametrize(
    ("state", "is_resumed", "after"),
    [
        ("isolated", True, "online"),
        ("suspect", True, "online"),
        ("isolated", False, "syncing"),
        ("quarantined", True, "quarantined"),
        ("syncing", True, "syncing"),
    ],
)
def test_a_heartbeat_brings_back_only_who_was_read_to_the_end(
    state: str, is_resumed: bool, after: str
) -> None:
    assert state_by_beat(SessionState(state), is_resumed=is_resumed).value == after
