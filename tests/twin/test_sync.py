"""The feed client against a small server that speaks the feed."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import msgspec
import pytest
from websockets.asyncio.server import ServerConnection, serve

from labweb.domain.errors import DefinitionError
from tests.twin import labs
from twin.state import GapError, Message, TwinLabView
from twin.sync import Config, FeedClient, next_wait_s, read_config

TOKEN = "a-service-token"


class SmallFeed:
    """Sends what the test wants, and keeps what it hears."""

    def __init__(self) -> None:
        self.lines: list[ServerConnection] = []
        self.heard: list[dict[str, object]] = []
        self.requests: list[tuple[str, str | None]] = []
        self.snapshot_seq = 1

    async def serve(self, line: ServerConnection) -> None:
        assert line.request is not None
        self.requests.append((line.request.path, line.request.headers.get("Authorization")))
        self.lines.append(line)
        await self.tell(self.snapshot_seq, "snapshot", labs.body())
        async for raw in line:
            self.heard.append(json.loads(raw))

    async def tell(self, seq: int, kind: str, data: object) -> None:
        await self.lines[-1].send(json.dumps({"seq": seq, "kind": kind, "data": data}))

    def asked(self) -> int:
        return sum(frame["kind"] == "snapshot" for frame in self.heard)


@asynccontextmanager
async def following() -> AsyncIterator[tuple[SmallFeed, TwinLabView]]:
    feed, view = SmallFeed(), TwinLabView()
    async with serve(feed.serve, "127.0.0.1", 0) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        config = Config(server_url=f"ws://127.0.0.1:{port}", token_file="")
        client = FeedClient(config, TOKEN, view, lambda: {"ports": {}, "is_fresh": True})
        task = asyncio.create_task(client.run())
        try:
            await until(lambda: view.snapshot is not None)
            yield feed, view
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(10):
        while not is_so():
            await asyncio.sleep(0.01)


def contents_of_bottle(view: TwinLabView) -> float:
    assert view.snapshot is not None
    return view.snapshot.resources["id-bottle"].total_ul


def bottle(microlitres: int) -> dict[str, object]:
    row = labs.body()["resources"]["id-bottle"]
    return {**row, "contents_nl": {"0": microlitres * 1000}}


def changed(microlitres: int) -> dict[str, object]:
    return {"changed": {"id-bottle": bottle(microlitres)}, "gone": []}


async def test_the_token_travels_in_the_header_and_not_in_the_url() -> None:
    async with following() as (feed, _):
        assert feed.requests == [("/ws/v1/feed", f"Bearer {TOKEN}")]


async def test_deltas_in_order_are_applied() -> None:
    async with following() as (feed, view):
        await feed.tell(2, "resources", changed(100))
        await feed.tell(3, "telemetry", {"d1": {"volume_ul": [5.0, 42.0]}})
        await feed.tell(4, "lab", {"key": "small", "name": "x", "mode": "sim", "is_stopped": True})
        await until(lambda: view.seq == 4)

        assert view.snapshot is not None
        assert contents_of_bottle(view) == 100.0
        assert view.snapshot.telemetry["d1"]["volume_ul"] == (5.0, 42.0)
        assert view.snapshot.lab.is_stopped
        assert feed.asked() == 0


async def test_after_a_gap_nothing_is_applied_until_the_snapshot_that_was_asked_for() -> None:
    async with following() as (feed, view):
        await feed.tell(2, "resources", changed(100))
        await feed.tell(4, "resources", changed(7))
        await feed.tell(5, "resources", changed(8))
        await until(lambda: feed.asked() == 1)
        assert contents_of_bottle(view) == 100.0

        fresh = labs.body()
        fresh["resources"]["id-bottle"] = bottle(9)
        await feed.tell(6, "snapshot", fresh)
        await feed.tell(7, "beat", {"at_s": 1.0})
        await until(lambda: view.seq == 7)

        assert contents_of_bottle(view) == 9.0
        assert feed.asked() == 1


async def test_a_line_that_breaks_is_opened_again_and_starts_from_a_snapshot() -> None:
    async with following() as (feed, view):
        feed.snapshot_seq = 50
        await feed.lines[-1].close()
        await until(lambda: view.seq == 50)

        assert len(feed.requests) == 2


async def test_a_message_of_no_known_kind_ends_the_line_and_not_the_twin() -> None:
    async with following() as (feed, view):
        await feed.tell(2, "gossip", {})
        await until(lambda: len(feed.requests) == 2 and view.seq == 1)

        await feed.tell(2, "resources", changed(3))
        await until(lambda: view.seq == 2)
        assert contents_of_bottle(view) == 3.0


async def test_the_twin_says_each_second_that_it_is_alive() -> None:
    async with following() as (feed, _):
        await until(lambda: len(feed.heard) >= 2)

        assert feed.heard[0] == {"kind": "alive", "data": {"ports": {}, "is_fresh": True}}


def test_what_is_gone_is_taken_out() -> None:
    view = TwinLabView()
    view.take(Message(1, "snapshot", labs.body()))
    view.take(Message(2, "resources", {"changed": {}, "gone": ["id-timer", "id-never"]}))

    assert view.snapshot is not None
    assert "id-timer" not in view.snapshot.resources


def test_a_delta_before_any_snapshot_is_a_gap() -> None:
    with pytest.raises(GapError):
        TwinLabView().take(Message(1, "lab", {}))


def test_a_row_of_another_shape_changes_nothing() -> None:
    view = TwinLabView()
    view.take(Message(1, "snapshot", labs.body()))

    with pytest.raises(msgspec.ValidationError):
        view.take(Message(2, "resources", {"changed": {"id-pump": {"id": 3}}}))
    assert view.seq == 1


def test_waiting_grows_from_half_a_second_to_eight_and_never_beyond() -> None:
    assert next_wait_s(0.5, 0.0) == 0.25
    assert next_wait_s(8.0, 0.999) < 8.0


def test_a_token_that_others_may_read_is_refused(tmp_path: Path) -> None:
    token = tmp_path / "token"
    token.write_text("secret")
    token.chmod(0o644)
    config = tmp_path / "twin.json"
    config.write_text(json.dumps({"server_url": "ws://127.0.0.1:1", "token_file": str(token)}))

    with pytest.raises(DefinitionError, match="0600"):
        read_config(config)
    token.chmod(0o600)
    assert read_config(config)[1] == "secret"


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"server_url": "http://x", "token_file": "t"}'])
def test_a_configuration_of_another_shape_is_refused(tmp_path: Path, text: str) -> None:
    config = tmp_path / "twin.json"
    config.write_text(text)

    with pytest.raises(DefinitionError):
        read_config(config)
