"""The hosts' websocket against garbage, giants, strangers and echoes."""

from __future__ import annotations

import base64
import errno
import hashlib
import time
from typing import Any
from uuid import uuid4

import msgspec
import pytest
from asgiref.sync import sync_to_async
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from labweb.crutd.models import Ticket
from labweb.domain.action_files import FileOffer, FilePart
from labweb.domain.messages.action_asks import ActionAsk, WithdrawAsk
from labweb.domain.messages.events import EventsFrame
from labweb.domain.messages.protocol_version import PROTOCOL_VERSION
from labweb.domain.messages.session import Heartbeat, Hello
from labweb.domain.messages.telemetry import TelemetryFrame
from labweb.runs import services
from labweb.runs.models import HostEvent, Run
from labweb.telemetry.models import File, Sample
from tests.builders import Bench, Edge, a_lab
from tests.labweb.sockets import Socket, a_socket

pytestmark = pytest.mark.django_db(transaction=True)

PATH = "/ws/edge/v1/"


@pytest.fixture
def bench(transactional_db: None) -> Bench:
    return a_lab()


async def nonce_of(socket: Socket) -> str:
    challenge = await socket.receive()
    assert challenge["t"] == "challenge"
    return str(challenge["nonce"])


async def send(socket: Socket, frame: msgspec.Struct) -> None:
    await socket.send_text(msgspec.json.encode(frame).decode())


async def answer_to(socket: Socket, hello: Hello) -> Any:  # noqa: ANN401 - JSON
    await send(socket, hello)
    return await socket.receive()


async def made(bench: Bench, **options: Any) -> Edge:  # noqa: ANN401 - as Edge takes
    return await sync_to_async(Edge)(bench, **options)


@pytest.mark.parametrize(
    "frame", ["", "{", "[]", "[" * 5000, '{"t": "hello"}', '{"t": "nobody"}', '{"t": "events"}']
)
async def test_garbage_closes_the_connection(bench: Bench, frame: str) -> None:
    async with a_socket(PATH, origin=None) as socket:
        await nonce_of(socket)
        await socket.send_text(frame)
        assert await socket.closed() == 4400


async def test_a_host_of_another_version_is_refused_with_the_reason_and_one_ticket(
    bench: Bench,
) -> None:
    edge = await made(bench)
    for _ in range(2):
        async with a_socket(PATH, origin=None) as socket:
            nonce = await nonce_of(socket)
            newer = msgspec.structs.replace(edge.hello(nonce), v=PROTOCOL_VERSION + 1)
            answer = await answer_to(socket, newer)
            assert (answer["t"], answer["code"]) == ("refuse", "host.version")
            assert answer["message"].endswith("update the server")
            assert await socket.closed() == 4403
    ticket = await Ticket.objects.aget()
    assert ticket.code == "host.version"
    assert "update the server" in ticket.message


async def test_a_frame_that_the_server_does_not_know_is_named_and_one_ticket_tells_of_it(
    bench: Bench,
) -> None:
    edge = await made(bench)
    for tag in ("wish_of_tomorrow", "wish_of_the_day_after"):
        async with a_socket(PATH, origin=None) as socket:
            await answer_to(socket, edge.hello(await nonce_of(socket)))
            await socket.receive()
            await socket.send_text(f'{{"t": "{tag}", "x": 1}}')
            assert await socket.closing() == (4400, f"frame {tag}")
    ticket = await Ticket.objects.aget()
    assert "wish_of_tomorrow" in ticket.message


async def test_a_frame_of_a_megabyte_closes_the_connection(bench: Bench) -> None:
    async with a_socket(PATH, origin=None) as socket:
        await nonce_of(socket)
        await socket.send_text("x" * 1_000_000)
        assert await socket.closed() == 1009


async def test_nothing_is_taken_before_the_host_has_proved_its_key(bench: Bench) -> None:
    edge = await made(bench)
    async with a_socket(PATH, origin=None) as socket:
        await nonce_of(socket)
        await send(socket, EventsFrame(epoch=0, events=[edge.event("boot", None)]))
        assert await socket.closed() == 4400
    assert not await HostEvent.objects.aexists()


async def test_a_host_that_proves_its_key_is_welcome(bench: Bench) -> None:
    edge = await made(bench)
    async with a_socket(PATH, origin=None) as socket:
        welcome = await answer_to(socket, edge.hello(await nonce_of(socket)))
        assert (welcome["t"], welcome["epoch"], welcome["mode"]) == ("welcome", 1, "normal")
        assert (await socket.receive())["t"] == "resume"
        await send(socket, EventsFrame(epoch=1, events=[edge.event("boot", None)]))
        assert await socket.receive() == {"t": "ack", "seq": 1}


async def test_a_signature_of_another_key_is_refused(bench: Bench) -> None:
    edge = await made(bench, key=Ed25519PrivateKey.generate())
    async with a_socket(PATH, origin=None) as socket:
        refusal = await answer_to(socket, edge.hello(await nonce_of(socket)))
        assert (refusal["t"], refusal["code"]) == ("refuse", "host.bad_signature")
        assert await socket.closed() == 4403


@pytest.mark.parametrize("signature", ["", "no base64 !", base64.b64encode(b"x" * 64).decode()])
async def test_a_signature_that_is_none_is_refused(bench: Bench, signature: str) -> None:
    edge = await made(bench)
    async with a_socket(PATH, origin=None) as socket:
        hello = edge.hello(await nonce_of(socket))
        refusal = await answer_to(socket, msgspec.structs.replace(hello, signature=signature))
        assert refusal["code"] == "host.bad_signature"


@pytest.mark.parametrize("field", ["seq_head", "epoch_last", "software", "boot_id"])
async def test_a_hello_that_was_changed_after_signing_is_refused(bench: Bench, field: str) -> None:
    edge = await made(bench)
    async with a_socket(PATH, origin=None) as socket:
        hello = edge.hello(await nonce_of(socket))
        value: Any = 99 if isinstance(getattr(hello, field), int) else "changed"
        changed = msgspec.structs.replace(hello, **{field: value})
        assert (await answer_to(socket, changed))["code"] == "host.bad_signature"


async def test_an_unknown_host_is_refused(bench: Bench) -> None:
    edge = await made(bench)
    edge.host_id = uuid4()
    async with a_socket(PATH, origin=None) as socket:
        refusal = await answer_to(socket, edge.hello(await nonce_of(socket)))
        assert refusal["code"] == "host.unknown"


async def test_a_hello_that_was_heard_before_is_refused(bench: Bench) -> None:
    edge = await made(bench)
    async with a_socket(PATH, origin=None) as socket:
        heard = edge.hello(await nonce_of(socket))
        assert (await answer_to(socket, heard))["t"] == "welcome"
    async with a_socket(PATH, origin=None) as socket:
        await nonce_of(socket)
        assert (await answer_to(socket, heard))["code"] == "host.bad_signature"


async def test_a_newer_session_ends_the_older_one(bench: Bench) -> None:
    edge = await made(bench)
    beat = Heartbeat(epoch=1, mono_s=1.0, seq_head=0, stop_latched=False, disk_free_bytes=1)
    async with a_socket(PATH, origin=None) as old, a_socket(PATH, origin=None) as new:
        assert (await answer_to(old, edge.hello(await nonce_of(old))))["epoch"] == 1
        assert (await old.receive())["t"] == "resume"
        assert (await answer_to(new, edge.hello(await nonce_of(new))))["epoch"] == 2
        await send(old, beat)
        assert await old.closed() == 4409


async def test_a_connection_without_a_hello_is_closed_within_seconds(bench: Bench) -> None:
    async with a_socket(PATH, origin=None) as socket:
        await nonce_of(socket)
        assert await socket.closed() == 4403


async def test_a_file_of_no_action_is_refused_and_the_connection_goes_on(bench: Bench) -> None:
    edge = await made(bench)
    data = b"\xff\xd8\xff no picture"
    action_id = uuid4()
    digest = hashlib.sha256(data).hexdigest()
    about: dict[str, Any] = {"action_id": action_id, "device_id": uuid4(), "sha256": digest}
    about["epoch"] = 1
    offer = FileOffer(size_bytes=len(data), **about)
    part = FilePart(offset_bytes=0, size_bytes=len(data), data=data, **about)
    async with a_socket(PATH, origin=None) as socket:
        await answer_to(socket, edge.hello(await nonce_of(socket)))
        assert (await socket.receive())["t"] == "resume"
        for frame in (offer, part):
            await send(socket, frame)
            answer = await socket.receive()
            assert (answer["t"], answer["code"]) == ("file_taken", "file.refused")
            assert (answer["action_id"], answer["sha256"]) == (str(action_id), digest)
    assert not await File.objects.aexists()


async def test_a_disk_that_takes_no_file_is_no_reason_to_hang_up(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    edge = await made(bench)
    about: dict[str, Any] = {"epoch": 1, "action_id": uuid4(), "device_id": uuid4()}
    about["sha256"] = hashlib.sha256(b"a curve").hexdigest()
    part = FilePart(offset_bytes=0, size_bytes=7, data=b"a curve", **about)

    def refuse(*_: object) -> str:
        raise OSError(errno.ENOSPC, "no space left on the disk")

    async with a_socket(PATH, origin=None) as socket:
        await answer_to(socket, edge.hello(await nonce_of(socket)))
        assert (await socket.receive())["t"] == "resume"
        with monkeypatch.context() as full:
            full.setattr("labweb.runs.services.take_file", refuse)
            await send(socket, part)
            await send(socket, FileOffer(size_bytes=7, **about))
            answer = await socket.receive()
        assert (answer["t"], answer["code"]) == ("file_taken", "file.refused"), "that of the offer"
        await send(socket, part)
        assert (await socket.receive())["code"] == "file.refused"


async def test_a_wish_is_told_to_its_end_and_counts_only_in_its_session(bench: Bench) -> None:
    people, edge = bench.people, await made(bench)
    await sync_to_async(services.let_ask)(
        edge.host_id, name=people["chemist"], actor=people["admin"]
    )
    device = await sync_to_async(bench.device)("timer_1")
    ask = ActionAsk(
        epoch=1, ask_id=uuid4(), device_id=device.id, action="wait", args={"duration_s": 1.0},
        source="ros2",
    )  # fmt: skip
    async with a_socket(PATH, origin=None) as socket:
        await answer_to(socket, edge.hello(await nonce_of(socket)))
        assert (await socket.receive())["t"] == "resume"
        await send(socket, msgspec.structs.replace(ask, epoch=7, ask_id=uuid4()))
        await send(socket, ask)
        told = await socket.receive()
        assert (told["t"], told["state"]) == ("ask_told", "awaiting_approval")
        await send(socket, WithdrawAsk(epoch=1, ask_id=ask.ask_id))
        told = await socket.receive()
        assert (told["state"], told["is_final"]) == ("stopped", True)
    assert await Run.objects.acount() == 1


async def test_samples_are_stored_before_the_host_hears_that_they_are(bench: Bench) -> None:
    edge = await made(bench)
    own, at = str((await sync_to_async(bench.device)("pump_1")).id), time.time()
    async with a_socket(PATH, origin=None) as socket:
        welcome = await answer_to(socket, edge.hello(await nonce_of(socket)))
        told: list[tuple[str, str, float, Any]] = [
            (own, "volume_ul", at, 5.0),
            (str(uuid4()), "volume_ul", at, 5.0),
        ]
        for key in ("7-0", ""):
            await send(socket, TelemetryFrame(epoch=welcome["epoch"], samples=told, key=key))
        while (frame := await socket.receive())["t"] != "telemetry_taken":
            continue
        assert frame["key"] == "7-0"
        rows = [(row.status, row.at, row.value) async for row in Sample.objects.all()]
        assert rows == [("volume_ul", at, 5.0)]
