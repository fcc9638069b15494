"""Floods on every websocket of the server: bounded by who sends them, and costing nobody else."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from threading import Event
from typing import Any

import msgspec
import pytest
from asgiref.sync import sync_to_async
from channels.routing import URLRouter
from django.conf import settings
from django.test import Client

from labweb.api import host_door, routing
from labweb.api.live import BrowserConsumer, NoSuchConsumer
from labweb.api.rate_limits import TERMS
from labweb.api.twin.feed import FeedConsumer
from labweb.common import sockets
from labweb.common.limits.concurrency import on_lane
from labweb.common.limits.token_buckets import Buckets, Rate
from labweb.common.sockets import CLOSE_TOO_FAST, BoundedConsumer
from labweb.enrollment.live import JoinConsumer
from labweb.fleet.live import EdgeConsumer
from tests.builders import Bench, Edge, a_lab
from tests.labweb.sockets import Socket, a_socket
from tests.labweb.web import signed_in

OWN_LANES = {EdgeConsumer: "uplink", JoinConsumer: "joining", FeedConsumer: "feed"}


def consumers_of(routes: list[Any]) -> Iterator[Any]:
    """The class behind each route, through whatever is wrapped around it."""
    for route in routes:
        callback = route.callback
        while not hasattr(callback, "consumer_class"):
            callback = callback.inner
        yield callback.consumer_class


def all_consumers() -> list[Any]:
    behind_door: Any = host_door.application().__closure__[0].cell_contents
    assert isinstance(behind_door, URLRouter)
    found = {*consumers_of(routing.routes), *consumers_of(behind_door.routes)}
    return sorted(found - {NoSuchConsumer}, key=lambda one: one.__name__)


@pytest.mark.parametrize("consumer", all_consumers(), ids=lambda one: one.__name__)
def test_every_socket_has_bounds_and_a_lane_and_the_hosts_share_theirs_with_nobody(
    consumer: type[BoundedConsumer],
) -> None:
    assert issubclass(consumer, BoundedConsumer)
    assert 0 < consumer.most_frame_bytes <= 2**20
    assert 0 < consumer.rate.per_s <= consumer.rate.burst_count
    assert consumer.lane in settings.LANES
    assert OWN_LANES.get(consumer, "socket") == consumer.lane
    sharing = [one for one in all_consumers() if one.lane == consumer.lane]
    assert consumer not in OWN_LANES or sharing == [consumer]


def test_no_request_shares_the_connections_of_the_hosts() -> None:
    assert not {terms.lane for terms in TERMS.values()} & {"uplink", "beat", "joining"}


class Probe(BoundedConsumer):
    """A socket that takes frames."""

    lane = "socket"
    most_frame_bytes = 100
    rate = Rate(per_s=1000, burst_count=3)
    most_strikes = 2

    sent: list[Any]
    taken: list[Any]

    async def receive(self, text_data: str | None = None, bytes_data: bytes | None = None) -> None:
        """Note the frame."""
        self.taken.append(text_data or bytes_data)

    async def tell_refusal(self, code: str, text: str) -> None:
        """Note what is told."""
        del text
        self.sent.append(code)

    async def close(self, code: Any = None, reason: Any = None) -> None:  # noqa: ANN401 - Channels' shape
        """Note the end."""
        self.sent.append((code, reason))


def a_probe(monkeypatch: pytest.MonkeyPatch, clock: Any = lambda: 0.0) -> Probe:  # noqa: ANN401
    probe = Probe()
    probe._is_opened = True
    probe.sent, probe.taken = [], []
    buckets = Buckets(Probe.rate, clock)
    monkeypatch.setattr(sockets, "_buckets", lambda *_: buckets)
    return probe


async def test_frames_beyond_the_rate_are_not_read_and_after_some_the_socket_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    probe = a_probe(monkeypatch)
    for number in range(6):
        await probe.websocket_receive({"text": str(number)})
    assert probe.taken == ["0", "1", "2"]
    assert probe.sent == ["feed.too_fast"] * 3 + [(CLOSE_TOO_FAST, "feed.too_fast")]


async def test_a_socket_that_has_proved_who_it_is_loses_no_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    probe = a_probe(monkeypatch)
    probe.is_patient = True
    for number in range(20):
        await probe.websocket_receive({"bytes": b"%d" % number})
    assert (len(probe.taken), probe.sent) == (20, [])


async def test_a_frame_that_is_too_large_is_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    probe = a_probe(monkeypatch)
    await probe.websocket_receive({"text": "é" * 51})
    assert (probe.taken, probe.sent) == ([], [(1009, None)])


@pytest.mark.django_db(transaction=True)
class TestOfOneLab:
    """With people and a host."""

    @pytest.fixture
    def bench(self, transactional_db: None) -> Bench:
        return a_lab()

    @pytest.fixture
    def clients(self, bench: Bench) -> dict[str, Client]:
        return {name: signed_in(user) for name, user in bench.people.items()}

    @pytest.fixture
    def few(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(BrowserConsumer, "rate", Rate(per_s=0.5, burst_count=30))
        monkeypatch.setattr(BrowserConsumer, "most_strikes", 1)
        monkeypatch.setattr(sockets, "_LONGEST_PAUSE_S", 0.01)

    @pytest.mark.usefixtures("few")
    async def test_topics_count_and_all_tabs_of_one_user_share_what_there_is(
        self, clients: dict[str, Client]
    ) -> None:
        observer = clients["observer"]
        async with a_socket("/ws/v1/", client=observer) as one:
            async with a_socket("/ws/v1/", client=observer) as other:
                await one.ask({"subscribe": ["runs", *map(str, range(25))]})
                told = await other.ask({"subscribe": [*map(str, range(25))]})
                assert told["error"]["code"] == "feed.too_fast"
                for _ in range(3):
                    await other.send_text('{"subscribe": ["runs", "a", "b"]}')
                while "error" in (frame := await other.frame()).get("text", ""):
                    pass
                assert (frame["code"], frame["reason"]) == (4429, "feed.too_fast")
            async with a_socket("/ws/v1/", client=clients["chemist"]) as own:
                assert await own.ask({"subscribe": ["runs"], "ping": 1}) == {"pong": 1}

    async def test_one_user_has_so_many_sockets_and_a_closed_one_is_free_again(
        self, clients: dict[str, Client], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(BrowserConsumer, "most_open", 2)
        observer = clients["observer"]
        async with a_socket("/ws/v1/", client=observer) as first:
            async with a_socket("/ws/v1/", client=observer) as second:
                assert await first.ask({"ping": 1}) == await second.ask({"ping": 1})
                async with a_socket("/ws/v1/", client=observer) as third:
                    assert (await third.receive())["error"]["code"] == "feed.too_many_sockets"
                    assert await third.closed() == 4429
            async with a_socket("/ws/v1/", client=observer) as again:
                assert await again.ask({"ping": 1}) == {"pong": 1}

    async def test_an_address_that_connects_too_often_is_told_so_on_every_socket(
        self, bench: Bench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        del bench
        for path in ("/ws/v1/", "/ws/v1/feed", "/ws/edge/v1/", "/twin/view/"):
            socket = Socket(path, [], client=("192.0.2.1", 0))
            shared = Buckets(Rate(0.001, 1), lambda: 0.0)
            shared.take("192.0.2.1")
            monkeypatch.setattr(sockets, "_buckets", lambda *_, shared=shared: shared)
            await socket.connect()
            frame, told = await socket.frame(), ""
            while frame["type"] == "websocket.send":
                told = frame.get("text") or told
                frame = await socket.frame()
            assert frame["code"] == CLOSE_TOO_FAST, path
            assert "wait 1000 s" in told or path == "/twin/view/", path
            await socket.leave()

    async def test_a_host_is_heard_while_observers_keep_their_lane_busy(
        self, bench: Bench, clients: dict[str, Client]
    ) -> None:
        gate, observer = Event(), clients["observer"]
        lane = BrowserConsumer.lane
        held = [on_lane(lane, gate.wait)(10) for _ in range(3 * settings.LANES[lane])]
        waiting = [asyncio.ensure_future(one) for one in held]
        try:
            edge = await sync_to_async(Edge)(bench)
            async with a_socket("/ws/edge/v1/") as socket:
                nonce = (await socket.receive())["nonce"]
                await socket.send_text(msgspec.json.encode(edge.hello(nonce)).decode())
                assert (await socket.receive())["t"] == "welcome"
        finally:
            gate.set()
            await asyncio.gather(*waiting)
        async with a_socket("/ws/v1/", client=observer) as own:
            assert await own.ask({"ping": 1}) == {"pong": 1}
