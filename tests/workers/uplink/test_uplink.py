"""The uplink against a server that speaks the same messages."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from uuid import uuid4

import msgspec
import pytest

from labweb.domain.action_files import UNKNOWN, FileAsked, FileGone, FilePart
from labweb.domain.errors import StateError
from labweb.domain.messages.action_asks import ActionAsk, AskTold, WithdrawAsk
from labweb.domain.messages.events import EventsFrame
from labweb.domain.messages.protocol_version import PROTOCOL_VERSION
from labweb.domain.messages.session import Heartbeat
from labweb.domain.messages.stops import StopLabFrame
from tests.workers.bench import HOST_ID, Host, a_do
from tests.workers.hub import Hub
from workers.base.config import HostConfig, ValkeyConfig
from workers.base.host_key import HostKey, create_key
from workers.base.valkey_store import ASKS, ASKS_TOLD, StatusSample, ValkeyStore
from workers.enrollment.host_identity import HostIdentity
from workers.line.action_files import ActionFiles
from workers.uplink import reconnect_backoff
from workers.uplink.host_reports import ASK_LIFE_S, BridgeWish
from workers.uplink.sample_delivery import StreamPosition
from workers.uplink.uplink import Uplink


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


@contextlib.asynccontextmanager
async def connected(host: Host, hub: Hub, key: HostKey, store: ValkeyStore) -> AsyncIterator[None]:
    config = HostConfig(
        host_id=HOST_ID,
        name="bench",
        server_url=hub.url,
        broker_url="memory://",
        data_dir=str(host.folder),
        key_file="-",
        valkey=ValkeyConfig(socket="/nowhere"),
    )
    identity = HostIdentity(key, Path("-"), None, None)
    made = Uplink(config, host.journal, identity, store, host.woken.append)
    task = asyncio.create_task(made.run())
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        # A connection that was cut on its way is closed by the loop, which needs a moment for it.
        await asyncio.sleep(0.05)


async def until(condition: Callable[[], object], within_s: float = 8.0) -> None:
    async with asyncio.timeout(within_s):
        while not condition():
            await asyncio.sleep(0.01)


async def test_every_event_goes_up_once_and_in_order_over_a_broken_line(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    hub.is_acking = False
    async with connected(host, hub, key, store):
        await until(lambda: hub.acked == 2)
        assert host.journal.acked_seq() == 0
        host.take(a_do(host.server))
        await asyncio.to_thread(hub.cut)
        hub.is_acking = True
        await until(lambda: host.journal.host_state().epoch == 3)
        host.take(a_do(host.server, resources=[]))
        await until(lambda: host.journal.acked_seq() == host.journal.head()[0])
    told = [kind for kind in hub.kinds if kind != "link_lost"]
    assert told == ["armed", "accepted", "accepted"]
    assert [hub.events[seq].hash for seq in sorted(hub.events)] == [e.hash for e in host.events()]


async def test_epoch_floor_devices_and_keys_are_on_disk_before_anything_is_sent(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    async with connected(host, hub, key, store):
        await until(lambda: hub.frames)
        assert host.journal.host_state().epoch == hub.server.epoch == 2
        assert host.journal.devices() == [host.device]
        assert host.journal.command_keys() == host.server.keys


async def test_a_long_backlog_goes_up_in_bounded_frames(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    with host.journal.write() as tx:
        for number in range(1200):
            tx.append("boot", None, {"number": number})
    async with connected(host, hub, key, store):
        await until(lambda: hub.acked == 1202)
    sizes = [len(frame.events) for frame in hub.frames if isinstance(frame, EventsFrame)]
    assert max(sizes) <= 500
    assert sum(sizes) == 1202


async def test_a_host_in_quarantine_is_disarmed(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    hub.mode, hub.will_resume = "quarantine", False
    async with connected(host, hub, key, store):
        await until(lambda: hub.frames)
        assert host.journal.host_state().armed_boot_id is None
        hub.mode, hub.will_resume = "normal", True
        await asyncio.to_thread(hub.cut)
        await until(lambda: host.journal.host_state().armed_boot_id is not None)


async def test_a_refused_host_stays_as_it_was_and_tries_again_later(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    hub.is_refusing = True
    async with connected(host, hub, key, store):
        await until(lambda: hub.hellos)
        await asyncio.sleep(0.2)
        assert host.journal.host_state().epoch == 1
        assert hub.frames == []


@pytest.mark.parametrize("fault", ["version", "frame"])
async def test_a_host_says_once_that_its_server_is_older_and_tries_more_and_more_seldom(
    host: Host,
    hub: Hub,
    key: HostKey,
    store: ValkeyStore,
    fault: str,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(reconnect_backoff, "LONGEST_RETRY_S", 0.05)
    if fault == "version":
        hub.version = PROTOCOL_VERSION - 1
    else:
        hub.knows = lambda frame: not isinstance(frame, Heartbeat)
    async with connected(host, hub, key, store):
        await until(lambda: len(hub.hellos) >= 3)
    said = [one.getMessage() for one in caplog.records if one.name == reconnect_backoff.__name__]
    assert len(said) == 1, said
    wanted = {"version": "update the server", "frame": "frame heartbeat"}
    assert wanted[fault] in said[0]
    # The server may have opened the next session already, of which the host has not heard yet.
    epochs = {1} if fault == "version" else {hub.server.epoch - 1, hub.server.epoch}
    assert host.journal.host_state().epoch in epochs


def test_a_server_that_is_not_understood_is_left_in_peace_for_minutes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("random.uniform", lambda _low, high: high)
    waiting = reconnect_backoff.ReconnectBackoff()
    refusal = reconnect_backoff.SessionRefusedError("update the server", code="host.version")
    pauses = [waiting.pause_s(refusal, "ws://x", lasted_s=20.0) for _ in range(8)]
    assert pauses == [8, 16, 32, 64, 128, 256, 300, 300]
    broken = [waiting.pause_s(OSError("away"), "ws://x", lasted_s=0.1) for _ in range(6)]
    assert broken == [0.5, 1, 2, 4, 8, 8], "what is away is asked again soon"


def test_a_session_that_lasted_makes_the_next_misfit_a_new_one(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("random.uniform", lambda _low, high: high)
    waiting = reconnect_backoff.ReconnectBackoff()
    error = msgspec.DecodeError("no such frame")
    pauses = [waiting.pause_s(error, "ws://x", lasted_s=86_400.0) for _ in range(3)]
    assert pauses == [8, 8, 8], "the host is away no longer than it has to be"
    assert len([one for one in caplog.records if one.name == reconnect_backoff.__name__]) == 3


async def test_a_nudge_is_as_good_as_the_broker(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    async with connected(host, hub, key, store):
        await until(lambda: hub.heartbeats)
        do = a_do(host.server)
        hub.nudge(host.server.sign(do))
        await until(lambda: "accepted" in hub.kinds)
        assert host.woken == [host.line]
        assert host.state(do.action_id) == "accepted"


async def test_the_stop_latch_is_on_disk_when_the_stop_is_acknowledged(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    async with connected(host, hub, key, store):
        await until(lambda: hub.heartbeats)
        hub.stop(StopLabFrame(stop_id=uuid4(), issued_by="ada"))
        await until(lambda: hub.acknowledged_stops)
        assert host.journal.host_state().stop_latched
        assert hub.acknowledged_stops[0].lines == []  # no executor listens in this test
        await until(lambda: "stop_latched" in hub.kinds)
        await until(lambda: hub.heartbeats[-1].halts_owed == {host.device.id})


def told(hub: Hub) -> list[float]:
    """Return the values of all samples that came, in order."""
    return [one[3] for frame in hub.telemetry for one in frame.samples]


def put(store: ValkeyStore, host: Host, values: range, *, taken: int = 0) -> None:
    device = str(host.device.id)
    for value in values:
        sample = StatusSample(device, "volume_ul", 1000.0 + value, 1.0, float(value))
        assert store.put("line", [sample], taken or value + 1, 100.0)


async def test_samples_that_wait_for_the_server_go_up_when_it_is_there(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    put(store, host, range(300))
    async with connected(host, hub, key, store):
        await until(lambda: len(told(hub)) == 300)
        put(store, host, range(300, 310))
        await until(lambda: len(told(hub)) == 310)
    assert told(hub) == list(range(310))
    assert all(not frame.gaps for frame in hub.telemetry)


async def test_samples_that_the_server_did_not_store_are_told_again(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    hub.is_storing = False
    put(store, host, range(5))
    async with connected(host, hub, key, store):
        await until(lambda: len(told(hub)) == 5)
        hub.is_storing = True
        await asyncio.to_thread(hub.cut)
        await until(lambda: len(told(hub)) == 10)
        await until(lambda: store.told() is not None)
    assert told(hub) == [*range(5)] * 2
    async with connected(host, hub, key, store):
        put(store, host, range(5, 6))
        await until(lambda: len(told(hub)) == 11)
    assert told(hub)[-1] == 5.0, "a process that begins anew goes on where the server stands"
    assert all(not frame.gaps for frame in hub.telemetry)


async def test_samples_that_fell_out_of_the_stream_are_told_as_a_gap(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    async with connected(host, hub, key, store):
        put(store, host, range(2))
        await until(lambda: len(told(hub)) == 2)
        put(store, host, range(7, 8))
        await until(lambda: len(told(hub)) == 3)
    (gap,) = [gap for frame in hub.telemetry for gap in frame.gaps]
    assert (gap.since_s, gap.until_s, gap.lost_count) == (1001.0, 1007.0, 5)
    assert gap.device_ids == [str(host.device.id)]
    assert hub.telemetry[-1].lost_count == 5


async def test_a_stream_that_was_lost_with_its_server_is_told_from_its_begin(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    put(store, host, range(3))
    store.keep_told(msgspec.json.encode(StreamPosition(key="9999999999999-0")))
    async with connected(host, hub, key, store):
        await until(lambda: len(told(hub)) == 3)


async def test_a_file_goes_up_whole_once_the_server_knows_it_and_is_kept_until_then(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    data = bytes(range(256)) * 2000
    sha256, action_id, device_id = hashlib.sha256(data).hexdigest(), uuid4(), uuid4()
    files = ActionFiles(host.folder / "files" / "line")
    with pytest.raises(StateError) as refusal:
        files.keep(action_id, device_id, sha256, data + b"x")
    assert refusal.value.code == "file.other_bytes"
    files.keep(action_id, device_id, sha256, data)
    hub.file_codes = [UNKNOWN]
    async with connected(host, hub, key, store):
        await until(lambda: len(hub.offers) == 1)
        assert not hub.files, "nothing is sent before the server wants it"
        assert len(files.waiting()) == 1, "it is kept while the server does not know it"
        await until(lambda: hub.files and not files.waiting())
    ((last, whole),) = hub.files
    assert whole == data
    assert (last.action_id, last.device_id, last.sha256) == (action_id, device_id, sha256)


async def test_a_file_that_the_server_does_not_want_is_dropped(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    files = ActionFiles(host.folder / "files" / "line")
    files.keep(uuid4(), uuid4(), hashlib.sha256(b"x").hexdigest(), b"x")
    hub.file_codes = ["file.refused"]
    async with connected(host, hub, key, store):
        await until(lambda: hub.offers and not files.waiting())
    assert (len(hub.offers), hub.files) == (1, [])


async def test_a_file_is_sent_again_after_the_line_was_cut_in_its_middle(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    data = bytes(range(256)) * 20_000
    files = ActionFiles(host.folder / "files" / "line")
    files.keep(uuid4(), uuid4(), hashlib.sha256(data).hexdigest(), data)
    parts_seen: list[int] = []

    def cut_once(frame: FilePart) -> bool:
        parts_seen.append(frame.offset_bytes)
        return len(parts_seen) == 5

    hub.cuts_at = cut_once
    async with connected(host, hub, key, store):
        await until(lambda: hub.files and not files.waiting())
    assert hub.files[-1][1] == data
    assert parts_seen.count(0) == 2, "it began anew"
    assert len(hub.hellos) == 2


async def test_a_file_that_was_damaged_or_is_gone_is_told_as_lost(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    files, action_id = ActionFiles(host.folder / "files" / "line"), uuid4()
    kept = files.keep(action_id, uuid4(), hashlib.sha256(b"xy").hexdigest(), b"xy")
    kept.write_bytes(b"xz")
    gone = FileAsked(action_id=uuid4(), device_id=uuid4(), sha256="0" * 64)

    def lost() -> set[object]:
        return {one.action_id for one in hub.frames if isinstance(one, FileGone)}

    async with connected(host, hub, key, store):
        await until(lambda: lost() == {action_id} and not files.waiting())
        assert hub.files == []
        await asyncio.to_thread(hub.send, gone)
        await until(lambda: lost() == {action_id, gone.action_id})


async def test_pictures_of_an_earlier_release_are_taken_over(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    sha256 = hashlib.sha256(b"p").hexdigest()
    (host.folder / "pictures").mkdir()
    (host.folder / "pictures" / f"{uuid4()}.{uuid4()}.{sha256}").write_bytes(b"p")
    async with connected(host, hub, key, store):
        await until(lambda: [whole for _, whole in hub.files] == [b"p"])


async def test_wishes_go_up_unless_they_are_old_and_words_about_them_come_down(
    host: Host, hub: Hub, key: HostKey, store: ValkeyStore
) -> None:
    old, new = uuid4(), uuid4()
    fields = {"device_id": uuid4(), "action": "wait", "args": {}, "source": "ros2"}

    def put(ask_id: object, age_s: float) -> None:
        ask = ActionAsk(epoch=0, ask_id=ask_id, **fields)  # type: ignore[arg-type]
        store.put_word(ASKS, msgspec.json.encode(BridgeWish(time.monotonic() - age_s, ask)))

    async with connected(host, hub, key, store):
        await until(lambda: hub.acked)
        await asyncio.to_thread(put, old, ASK_LIFE_S + 1)
        await asyncio.to_thread(put, new, 0.0)
        withdrawn = BridgeWish(time.monotonic(), WithdrawAsk(epoch=0, ask_id=new))
        await asyncio.to_thread(store.put_word, ASKS, msgspec.json.encode(withdrawn))
        await until(lambda: any(isinstance(one, WithdrawAsk) for one in hub.frames))
        told = AskTold(ask_id=new, state="queued", run_number=3)
        await asyncio.to_thread(hub.send, told)
        words: list[bytes] = []

        def take() -> list[bytes]:
            words.extend(store.take_words(ASKS_TOLD))
            return words

        await until(take)
    asks = [one for one in hub.frames if isinstance(one, ActionAsk)]
    assert [(one.ask_id, one.epoch) for one in asks] == [(new, hub.server.epoch)]
    assert msgspec.json.decode(words[0], type=AskTold) == told
