"""The browser's websocket: who gets in, what they hear, and when it ends."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from uuid import UUID

import pytest
from asgiref.sync import sync_to_async
from django.test import Client
from pytest_django import Settings

from labweb.accounts.selectors import User
from labweb.api import live
from labweb.common import feed
from labweb.runs.models import Run
from tests.builders import Bench, a_lab, a_started_run, a_user
from tests.labweb.sockets import HOST, OWN, Socket, a_socket
from tests.labweb.web import signed_in

pytestmark = pytest.mark.django_db(transaction=True)


@pytest.fixture
def chemist(transactional_db: None) -> tuple[Bench, Client]:
    bench = a_lab()
    return bench, signed_in(bench.people["chemist"])


@pytest.mark.parametrize(
    "origin",
    [
        None,
        b"",
        b"null",
        b"http://evil.example",
        b"http://127.0.0.1:8401",
        b"http://127.0.0.1:8400.evil.example",
        b"http://evil.example/127.0.0.1:8400",
    ],
)
async def test_a_page_of_another_origin_is_refused(
    chemist: tuple[Bench, Client], origin: bytes | None
) -> None:
    async with a_socket("/ws/v1/", client=chemist[1], origin=origin) as socket:
        assert await socket.closed() == 4403


async def test_a_name_that_is_not_ours_is_refused_though_page_and_host_agree(
    chemist: tuple[Bench, Client], settings: Settings
) -> None:
    settings.ALLOWED_HOSTS = ["lab.example.org"]
    async with a_socket("/ws/v1/", client=chemist[1]) as socket:
        assert await socket.closed() == 4403


async def test_a_stranger_is_refused(transactional_db: None) -> None:
    async with a_socket("/ws/v1/") as socket:
        assert await socket.closed() == 4401


async def test_who_has_no_grant_is_refused(chemist: tuple[Bench, Client]) -> None:
    bench, client = chemist
    await sync_to_async(bench.people["chemist"].grants.all().delete)()
    async with a_socket("/ws/v1/", client=client) as socket:
        assert await socket.closed() == 4401


async def test_a_member_hears_what_they_asked_for(chemist: tuple[Bench, Client]) -> None:
    async with a_socket("/ws/v1/", client=chemist[1]) as socket:
        await socket.ask({"subscribe": ["runs"], "ping": 1})
        await asyncio.sleep(0.2)
        for topic in ("hosts", "runs"):
            await sync_to_async(feed.publish)(topic, {"about": topic})
        heard = await socket.receive()
        assert (heard["topic"], heard["seq"], heard["data"]) == ("runs", 1, {"about": "runs"})


async def test_what_is_asked_for_while_rights_are_looked_up_again_is_not_forgotten(
    chemist: tuple[Bench, Client], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "CHECK_EVERY_S", 0.0)
    async with a_socket("/ws/v1/", client=chemist[1]) as socket:
        for count in range(40):
            await socket.send_text(json.dumps({"subscribe": ["runs"]}))
            assert await socket.ask({"ping": count}) == {"pong": count}
            await sync_to_async(feed.publish)("runs", {"count": count})
            assert (await socket.receive())["data"] == {"count": count}
            await socket.send_text(json.dumps({"unsubscribe": ["runs"]}))


@pytest.mark.parametrize(
    "frame",
    ["x" * 1_000_000, json.dumps({"subscribe": ["y" * 70_000]}), "\u00e9" * 40_000],
)
async def test_a_frame_of_a_megabyte_closes_the_socket(
    chemist: tuple[Bench, Client], frame: str
) -> None:
    async with a_socket("/ws/v1/", client=chemist[1]) as socket:
        await socket.send_text(frame)
        assert await socket.closed() == 1009


@pytest.mark.parametrize(
    "frame",
    [
        *("", "{", "[]", "7", '{"subscribe": 7}', "[" * 5000),
        *('{"ping": NaN}', '{"ping": -Infinity}', '{"ping": 1e400}', f'{{"ping": {"9" * 5000}}}'),
    ],
)
async def test_a_frame_that_makes_no_sense_closes_the_socket(
    chemist: tuple[Bench, Client], frame: str
) -> None:
    async with a_socket("/ws/v1/", client=chemist[1]) as socket:
        await socket.send_text(frame)
        assert await socket.closed() == 4400


@pytest.mark.parametrize(("length", "code"), [(2, 4400), (70_000, 1009)])
async def test_bytes_close_the_socket(
    chemist: tuple[Bench, Client], length: int, code: int
) -> None:
    async with a_socket("/ws/v1/", client=chemist[1]) as socket:
        await socket.send_bytes(b"\x00" * length)
        assert await socket.closed() == code


@pytest.mark.parametrize("path", ["/ws/none/", "/ws/v1", "/ws/", "/", "/twin/none"])
async def test_a_socket_at_an_address_that_is_none_is_refused(path: str) -> None:
    socket = Socket(path, [(b"host", HOST), (b"origin", OWN)])
    assert await socket.refused()


@pytest.mark.parametrize(
    "topic",
    ["", "everything", "run:", "run:x", f"run:{UUID(int=7)}", f"telemetry:{UUID(int=7)}", "feed"],
)
async def test_a_topic_that_is_none_is_refused(chemist: tuple[Bench, Client], topic: str) -> None:
    async with a_socket("/ws/v1/", client=chemist[1]) as socket:
        answer = await socket.ask({"subscribe": [topic]})
        assert answer["error"]["code"] == "feed.unknown_topic"


async def test_a_topic_that_is_none_silences_none_beside_it(
    chemist: tuple[Bench, Client],
) -> None:
    async with a_socket("/ws/v1/", client=chemist[1]) as socket:
        answer = await socket.ask({"subscribe": ["lab", f"run:{UUID(int=7)}"]})
        assert answer["error"] == {
            "code": "feed.unknown_topic",
            "message": f"no topic run:{UUID(int=7)}",
        }
        await asyncio.sleep(0.2)
        await sync_to_async(feed.publish)("lab", {})
        assert (await socket.receive())["topic"] == "lab"


async def test_too_many_topics_are_refused(chemist: tuple[Bench, Client]) -> None:
    async with a_socket("/ws/v1/", client=chemist[1]) as socket:
        answer = await socket.ask({"subscribe": [f"run:{n}" for n in range(201)]})
        assert answer["error"]["code"] == "feed.too_many"


def a_guest(bench: Bench) -> tuple[User, Run]:
    return a_user("chemist", on=bench.node("balance_1"), name="guest"), a_started_run(bench)


async def test_a_run_or_device_outside_ones_subtree_cannot_be_listened_to(
    chemist: tuple[Bench, Client],
) -> None:
    bench, client = chemist
    guest, run = await sync_to_async(a_guest)(bench)
    pump = (await sync_to_async(bench.device)("pump_1")).id
    balance = (await sync_to_async(bench.device)("balance_1")).id
    async with a_socket("/ws/v1/", client=await sync_to_async(signed_in)(guest)) as socket:
        for topic in (f"run:{run.id}", f"telemetry:{pump}"):
            answer = await socket.ask({"subscribe": [topic]})
            assert answer["error"]["code"] == "feed.unknown_topic"
        assert await socket.ask({"subscribe": [f"telemetry:{balance}"], "ping": 2}) == {"pong": 2}
    async with a_socket("/ws/v1/", client=client) as socket:
        both = [f"run:{run.id}", f"telemetry:{pump}"]
        assert await socket.ask({"subscribe": both, "ping": 3}) == {"pong": 3}
        await asyncio.sleep(0.2)
        await sync_to_async(feed.publish)(f"telemetry:{pump}", {"samples": []})
        assert (await socket.receive())["topic"] == both[1]


def sign_out(bench: Bench, client: Client) -> None:
    client.logout()


def disable(bench: Bench, client: Client) -> None:
    User.objects.filter(pk=bench.people["chemist"].pk).update(is_active=False)


def change_password(bench: Bench, client: Client) -> None:
    user = bench.people["chemist"]
    user.set_password("another-long-passphrase")
    user.save(update_fields=["password"])


@pytest.mark.parametrize("end", [sign_out, disable, change_password])
async def test_the_socket_closes_within_five_seconds_of_its_session(
    chemist: tuple[Bench, Client], end: Callable[[Bench, Client], None]
) -> None:
    bench, client = chemist
    async with a_socket("/ws/v1/", client=client) as socket:
        assert await socket.ask({"ping": 1}) == {"pong": 1}
        await sync_to_async(end)(bench, client)
        began = time.monotonic()
        assert await socket.closed() == 4401
        assert time.monotonic() - began < 5


async def test_a_lost_grant_ends_what_one_hears(chemist: tuple[Bench, Client]) -> None:
    bench, client = chemist
    pump = (await sync_to_async(bench.device)("pump_1")).id
    topic = f"telemetry:{pump}"
    async with a_socket("/ws/v1/", client=client) as socket:
        await socket.ask({"subscribe": [topic], "ping": 1})
        user = bench.people["chemist"]
        balance = await sync_to_async(bench.node)("balance_1")
        await sync_to_async(user.grants.update)(resource=balance)
        hears, began = True, time.monotonic()
        while hears:
            assert time.monotonic() - began < 10, "it still hears what it may not see"
            await asyncio.sleep(0.5)
            await sync_to_async(feed.publish)(topic, {"samples": []})
            hears = not await socket.is_silent(0.5)
            while not await socket.is_silent(0.1):
                await socket.receive()
        await sync_to_async(feed.publish)(topic, {"samples": []})
        assert await socket.is_silent(0.5)
