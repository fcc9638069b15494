"""The twin's only door: who gets in, what gets through, and when it is shut."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path

import httpx
import msgspec
import pytest
from django.conf import settings
from websockets.asyncio.client import ClientConnection, connect
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed, InvalidStatus

from labweb.api.twin.feed import FeedConsumer
from labweb.api.twin.proxy import POLICY, allowed_frame
from labweb.common import feed
from tests.labweb.api.twin_site import VISER, Site, there_is_a_twin_at
from twin.server import Painter, Viewer
from twin.state import TwinLabView
from twin.sync import Config, FeedClient

CAMERA = msgspec.msgpack.encode({"type": "ViewerCameraMessage", "fov": 1.0})
SHARE = msgspec.msgpack.encode({"type": "ShareUrlRequest"})


@pytest.fixture(scope="module")
def viser_port() -> Iterator[int]:
    """Run the real viser."""
    painter = Painter("light")
    yield painter.port
    painter.stop()


class Echo:
    """Stands where viser stands and keeps every frame that gets through."""

    def __init__(self) -> None:
        self.frames: list[bytes] = []

    async def take(self, line: ServerConnection) -> None:
        await line.send(b"hello")
        async for frame in line:
            assert isinstance(frame, bytes)
            self.frames.append(frame)


@asynccontextmanager
async def echo() -> AsyncIterator[Echo]:
    found = Echo()
    async with serve(found.take, "127.0.0.1", 0, subprotocols=[VISER]) as server:
        there_is_a_twin_at(next(iter(server.sockets)).getsockname()[1])
        yield found


async def until(is_so: Callable[[], bool], within_s: float = 10.0) -> None:
    async with asyncio.timeout(within_s):
        while not is_so():
            await asyncio.sleep(0.02)


@contextmanager
def refused(status: int = 403) -> Iterator[None]:
    with pytest.raises(InvalidStatus) as caught:
        yield
    assert caught.value.response.status_code == status


def test_a_viewer_gets_visers_page_with_a_policy_of_its_own(site: Site, viser_port: int) -> None:
    there_is_a_twin_at(viser_port)
    client = site.client()

    answer = client.get("/twin/view/", headers={"Accept-Encoding": "gzip"})

    assert answer.status_code == 200
    assert "<!doctype html>" in answer.text[:200].lower()
    assert len(answer.content) > 100_000
    assert answer.headers["content-security-policy"] == POLICY
    assert answer.headers["x-frame-options"] == "SAMEORIGIN"
    assert client.get("/twin/view/dark/").content == answer.content
    assert "unsafe-eval" not in client.get("/healthz").headers["content-security-policy"]


def test_nobody_signed_in_sees_nothing(site: Site, viser_port: int) -> None:
    there_is_a_twin_at(viser_port)
    client = site.client(None)

    assert client.get("/twin/view/").status_code == 403
    assert client.get("/api/v1/twin").status_code in {401, 403}


def test_a_user_without_the_lab_sees_nothing(site: Site, viser_port: int) -> None:
    there_is_a_twin_at(viser_port)
    client = site.client("observer")
    site.bench.people["observer"].grants.all().delete()

    assert client.get("/twin/view/").status_code == 403


@pytest.mark.parametrize(
    "path",
    [
        "/twin/view/..%2f..%2fetc/passwd",
        "/twin/view/%2e%2e/%2e%2e/infra/_infra.py",
        "/twin/view/%252e%252e/x",
        "/twin/view/..\\..\\x",
        "/twin/view/.hidden",
        "/twin/view/a//b",
        "/twin/view/nothing-here.js",
        "/twin/view/?websocket=ws://evil.example/",
        "/twin/view/?playbackPath=https://evil.example/x.viser",
    ],
)
def test_odd_paths_and_parameters_are_not_found(site: Site, viser_port: int, path: str) -> None:
    there_is_a_twin_at(viser_port)
    client = site.client()
    raw = httpx.URL(site.url).copy_with(raw_path=path.encode())

    assert client.get(raw).status_code == 404


def test_the_page_without_its_slash_is_sent_to_the_one_with_it(site: Site) -> None:
    answer = site.client().get("/twin/view")

    assert answer.status_code == 302
    assert answer.headers["location"] == "/twin/view/"


def test_while_the_twin_is_away_the_page_says_so(site: Site) -> None:
    client = site.client()

    assert client.get("/twin/view/").status_code == 503
    assert client.get("/api/v1/twin").json() == {"state": "offline", "url": "/twin/view/"}


async def test_the_line_carries_visers_protocol_and_its_frames(site: Site) -> None:
    client = await asyncio.to_thread(site.client)
    async with echo() as twin, site.line(client) as line:
        assert line.subprotocol == VISER
        assert await line.recv() == b"hello"
        await line.send(CAMERA)
        await until(lambda: twin.frames == [CAMERA])


async def test_a_wish_to_publish_the_scene_never_reaches_viser(site: Site) -> None:
    client = await asyncio.to_thread(site.client)
    async with echo() as twin, site.line(client) as line:
        await line.send(SHARE)
        await line.send(b"\xc1 no msgpack")
        await line.send(b"\x82\xa4type\xb3ViewerCameraMessage\xa4type\xafShareUrlRequest")
        await line.send(CAMERA)
        await until(lambda: bool(twin.frames))

        assert twin.frames == [CAMERA]


def test_what_viser_would_read_is_what_was_checked() -> None:
    double = b"\x82\xa4type\xafShareUrlRequest\xa4type\xb3ViewerCameraMessage"

    passed = allowed_frame(double)

    assert passed is not None
    assert b"ShareUrlRequest" not in passed
    assert allowed_frame(msgspec.msgpack.encode(["ViewerCameraMessage"])) is None
    assert allowed_frame(msgspec.msgpack.encode({"type": ["ViewerCameraMessage"]})) is None


def test_viser_itself_refuses_to_publish_the_scene() -> None:
    assert Viewer.request_share_url(object.__new__(Viewer)) is None


@pytest.mark.parametrize(
    ("path", "origin"),
    [
        ("/twin/view", "http://evil.example"),
        ("/twin/view", "null"),
        ("/twin/view?websocket=ws://evil.example", None),
    ],
)
async def test_a_foreign_page_gets_no_line(site: Site, path: str, origin: str | None) -> None:
    client = await asyncio.to_thread(site.client)
    async with echo():
        with refused():
            async with site.line(client, path, origin):
                pass


async def test_nobody_signed_in_gets_no_line(site: Site) -> None:
    client = await asyncio.to_thread(site.client, None)
    async with echo():
        with refused():
            async with site.line(client):
                pass


async def _is_cut(line: ClientConnection) -> int | None:
    with suppress(ConnectionClosed):
        async with asyncio.timeout(5):
            while True:
                await line.recv()
    return line.close_code


async def test_signing_out_cuts_the_line_within_five_seconds(site: Site) -> None:
    client = await asyncio.to_thread(site.client)
    async with echo(), site.line(client) as line:
        await line.recv()
        await asyncio.to_thread(client.delete, "/api/v1/session", headers=site.csrf(client))

        assert await _is_cut(line) == 4401


async def test_a_user_who_is_disabled_loses_the_line_within_five_seconds(site: Site) -> None:
    client = await asyncio.to_thread(site.client)
    user = site.bench.people["observer"]
    user.is_active = False
    async with echo(), site.line(client) as line:
        await line.recv()
        await asyncio.to_thread(user.save)

        assert await _is_cut(line) == 4401


async def test_a_frame_that_is_too_large_ends_the_line(site: Site) -> None:
    client = await asyncio.to_thread(site.client)
    async with echo() as twin, site.line(client) as line:
        await line.recv()
        await line.send(b"\0" * (64 * 1024 + 1))

        assert await _is_cut(line) == 1009
        assert twin.frames == []


async def test_when_viser_goes_the_line_goes(site: Site) -> None:
    client = await asyncio.to_thread(site.client)
    async with echo():
        line = await site.line(client)
        await line.recv()

    assert await _is_cut(line) == 1013


@asynccontextmanager
async def following(site: Site, token: str) -> AsyncIterator[TwinLabView]:
    view = TwinLabView()
    config = Config(server_url=f"ws://127.0.0.1:{site.port}", token_file="")
    alive = {"ports": {"light": 1}, "is_fresh": True, "clients_count": 0}
    task = asyncio.create_task(FeedClient(config, token, view, lambda: alive).run())
    try:
        yield view
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


@pytest.fixture
def token() -> str:
    path = Path(settings.TWIN_TOKEN_FILE)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("the-service-token\n")
    return "the-service-token"


async def test_a_twin_with_the_token_gets_the_lab_and_is_online(site: Site, token: str) -> None:
    client = await asyncio.to_thread(site.client)
    async with following(site, token) as view:
        await until(lambda: view.snapshot is not None)

        assert view.snapshot is not None
        rows = {row.key: row for row in view.snapshot.resources.values()}
        assert rows["water"].total_ul == 400_000.0
        assert rows["timer_1"].pose is None
        assert view.snapshot.lab.name == "Starter lab"
        assert len(view.snapshot.devices) == 6
        answer = await asyncio.to_thread(client.get, "/api/v1/twin")
        assert answer.json()["state"] == "online"


async def test_a_twin_hears_of_a_change_and_of_samples(site: Site, token: str) -> None:
    async with following(site, token) as view:
        await until(lambda: view.snapshot is not None)
        assert view.snapshot is not None
        lab = site.bench.lab
        lab.is_stopped = True
        await asyncio.to_thread(lab.save)
        await asyncio.to_thread(feed.publish, "lab", {"is_stopped": True})
        samples = {"device_id": "d", "samples": [["volume_ul", 1.0, 5.0]]}
        await asyncio.to_thread(feed.publish, "telemetry:d", samples)

        await until(lambda: view.snapshot is not None and view.snapshot.lab.is_stopped)
        await until(lambda: "d" in view.snapshot.telemetry if view.snapshot else False)
        assert view.snapshot.telemetry["d"] == {"volume_ul": (1.0, 5.0)}


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/ws/v1/feed", {}),
        ("/ws/v1/feed", {"Authorization": "Bearer wrong"}),
        ("/ws/v1/feed", {"Authorization": "Bearer "}),
        ("/ws/v1/feed?token=the-service-token", {}),
        ("/ws/v1/feed?token=x", {"Authorization": "Bearer the-service-token"}),
    ],
)
async def test_the_feed_is_closed_to_all_others(
    site: Site, token: str, path: str, headers: dict[str, str]
) -> None:
    with refused():
        async with connect(
            f"ws://127.0.0.1:{site.port}{path}", additional_headers=headers, proxy=None
        ):
            pass


def test_the_feed_has_no_message_to_change_anything() -> None:
    assert {name for name in vars(FeedConsumer) if not name.startswith("_")} <= {
        "connect", "disconnect", "receive", "feed_messages", "lane", "most_frame_bytes", "rate",
    }  # fmt: skip
