"""A host measures the server's clock, keeps that, and dates by it what it tells."""

from __future__ import annotations

import asyncio
import sqlite3
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from labweb.domain.messages.events import EdgeEvent, event_hash
from labweb.domain.messages.session import Pulse, Welcome
from labweb.domain.runs.host_link.host_clocks import ClockAnchor
from tests.workers.bench import Host, a_do
from tests.workers.hub import Hub
from tests.workers.uplink.test_uplink import connected, until
from workers.base.host_key import HostKey, create_key
from workers.base.valkey_store import ValkeyStore
from workers.journal import journal_schema
from workers.journal.journal import Journal
from workers.uplink.server_clock import MOST_ASKED, ServerClock, read_anchors

DAY_S = 86_400.0


@pytest.fixture
def host(tmp_path: Path) -> Iterator[Host]:
    made = Host(tmp_path / "host", "tcp://127.0.0.1:9")
    yield made
    made.journal.close()


@pytest.fixture
def key(tmp_path: Path) -> HostKey:
    return create_key(tmp_path / "host.key")


@pytest.fixture
def hub(host: Host, key: HostKey) -> Iterator[Hub]:
    made = Hub(host.server, [host.device], key.public_base64)
    with made.open():
        yield made


def off_s(event: EdgeEvent, hub: Hub) -> float:
    """Return how far the time that the host tells is from the server's at that moment."""
    assert event.happened_s is not None
    return abs(event.happened_s - (event.at_s + hub.ahead_s))


async def test_what_a_host_tells_is_dated_by_the_server_a_day_ahead(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    """What was written before the session too, and the measure outlives the program."""
    hub.ahead_s = DAY_S
    async with connected(host, hub, key, store):
        await until(lambda: hub.acked >= 2)
        host.take(a_do(host.server))
        await until(lambda: "accepted" in hub.kinds)
        await until(lambda: store.anchor() is not None)
    for event in hub.events.values():
        assert event.uncertainty_s is not None
        assert event.uncertainty_s < 1.0
        assert off_s(event, hub) <= event.uncertainty_s + 0.005
        assert event.boot_id == host.journal.boot_id
    told = msgspec.json.decode(store.anchor() or b"", type=ClockAnchor)
    assert abs(told.server_at_s - told.wall_s - DAY_S) < 1.0
    [again] = ServerClock(host.journal, store).dated([hub.events[1]])
    assert again.uncertainty_s is not None
    assert off_s(again, hub) <= again.uncertainty_s + 0.005


async def test_signs_of_life_measure_again(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    """The answer to HELLO was slow; the next measure is better, without another session."""
    hub.ahead_s, hub.way_s = -DAY_S, 0.2
    async with connected(host, hub, key, store):
        await until(lambda: len(hub.heartbeats) >= 3)
        await asyncio.sleep(0.1)
        first = read_anchors(host.journal)[0]
        latest = msgspec.json.decode(store.anchor() or b"", type=ClockAnchor)
    assert len(hub.hellos) == 1
    assert latest.mono_s > first.mono_s
    assert latest.error_s < first.error_s


def test_an_answer_that_nobody_waits_for_measures_nothing(host: Host, store: ValkeyStore) -> None:
    clock = ServerClock(host.journal, store)
    asked = [clock.ask() for _ in range(MOST_ASKED + 1)]
    for asked_s in (asked[0], -5.0):
        clock.hear(Pulse(asked_s=asked_s, heard_at_s=1.0, told_at_s=1.0))
    assert read_anchors(host.journal) == ()
    clock.hear(Pulse(asked_s=asked[-1], heard_at_s=1.0, told_at_s=1.0))
    assert len(read_anchors(host.journal)) == 1


def test_a_host_whose_clock_was_set_in_the_night_is_not_misled(
    host: Host, store: ValkeyStore
) -> None:
    """The clock that only runs counts; the one that was set is written down beside it."""
    now_s = time.time()
    clock = ServerClock(host.journal, store)
    welcome: Welcome = host.server.welcome(server_at_s=now_s, heard_at_s=now_s)
    clock.open(host.journal.moment(), welcome)
    set_back = Journal(host.path, wall_s=lambda: time.time() - DAY_S)
    with set_back.write() as tx:
        tx.append("boot", None, {"is_at_night": True})
    set_back.close()
    [event] = [one for one in host.journal.events_after(0) if "is_at_night" in one.body]
    assert event.at_s < now_s - DAY_S + 60
    [told] = clock.dated([event])
    assert told.happened_s is not None
    assert now_s - 1 < told.happened_s <= time.time() + 1


def test_the_events_of_an_older_program_keep_their_hashes(tmp_path: Path, host: Host) -> None:
    """Their columns come with the migration, and they carry one clock as before."""
    path = tmp_path / "old.sqlite"
    bare = EdgeEvent(
        seq=1, prev_hash="", hash="", kind="boot", action_id=None, at_s=7.0, body={"a": 1}
    )
    digest = event_hash(host.journal.journal_id, "", bare)
    connection = sqlite3.connect(path, isolation_level=None)
    connection.row_factory = sqlite3.Row
    connection.executescript(journal_schema.VERSION_1 + "PRAGMA user_version = 1;")
    connection.execute(
        "INSERT INTO event VALUES (1, '', ?, 'boot', NULL, 7.0, ?)", (digest, '{"a":1}')
    )
    journal_schema.migrate(connection)
    found = journal_schema.to_event(connection.execute("SELECT * FROM event").fetchone())
    connection.close()
    assert (found.mono_s, found.boot_id, found.hash) == (None, "", digest)
    assert event_hash(host.journal.journal_id, "", found) == digest
