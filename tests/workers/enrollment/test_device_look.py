"""A host looks at a device that no line serves: it reads, and moves nothing."""

from __future__ import annotations

import asyncio
import socket
import threading
from typing import Any, cast
from uuid import uuid4

import msgspec
import pytest
from websockets.asyncio.client import ClientConnection

from drivers.catalog.bundle import gather
from drivers.catalog.source import path_of, read_source
from labweb.domain.enrollment.driver_bundle import digest_of, encode_bundle
from labweb.domain.messages.device_looks import LookOrder, LookPart, LookTold
from labweb.domain.messages.devices_and_drivers import DriverApproval
from tests.workers.bench import HOST_ID, MODULE, Host, PumpProcess, Server, a_device
from tests.workers.sandbox.test_confinement import confining
from workers.enrollment import device_look
from workers.enrollment.device_look import DeviceLooks
from workers.journal.journal import Journal
from workers.uplink.session import open_session

pytestmark = confining

MODULES = gather(read_source(path_of(MODULE)))


class Wire:
    """The far end of an uplink: keeps what was sent."""

    def __init__(self) -> None:
        self.sent: asyncio.Queue[LookTold] = asyncio.Queue()

    async def send(self, text: str | bytes) -> None:
        self.sent.put_nowait(msgspec.json.decode(text, type=LookTold))


def an_order(host: Host, **changes: Any) -> LookOrder:  # noqa: ANN401 - any field
    known = LookOrder(
        look_id=uuid4(),
        host_id=HOST_ID,
        epoch=host.server.epoch,
        digest=digest_of(MODULES),
        class_name="TricontinentC3000",
        transport=host.url,
        config={"syringe_ul": 1000.0},
        asked_by="1",
    )
    return msgspec.structs.replace(known, **changes)


def parts_of(host: Host, order: LookOrder, signer: Server | None = None) -> list[LookPart]:
    approval = DriverApproval(
        digest=digest_of(MODULES), module=MODULE, class_name=order.class_name, origin="release"
    )
    data = encode_bundle(MODULES)
    half = len(data) // 2
    first = LookPart(
        look_id=order.look_id,
        index=0,
        count=2,
        data=data[:half],
        order=(signer or host.server).sign(order),
        approval=host.server.sign(approval),
    )
    return [first, LookPart(look_id=order.look_id, index=1, count=2, data=data[half:])]


def looked(host: Host, *parts: LookPart, within_s: float = 40.0) -> LookTold:
    async def look() -> LookTold:
        looks, wire = DeviceLooks(host.journal), Wire()
        for part in parts:
            looks.take(part)
        talk = looks.tell(cast("ClientConnection", wire), lambda: host.server.epoch)
        serving = asyncio.create_task(talk)
        try:
            async with asyncio.timeout(within_s):
                return await wire.sent.get()
        finally:
            serving.cancel()
            await asyncio.gather(serving, return_exceptions=True)

    return asyncio.run(look())


@pytest.fixture
def free(host: Host) -> Host:
    """A host that serves nothing."""
    open_session(host.journal, host.server.welcome())
    assert host.journal.devices() == []
    return host


def test_it_says_who_answers_and_what_it_tells_and_nothing_moves(
    free: Host, pump: PumpProcess
) -> None:
    order = an_order(free)
    told = looked(free, *parts_of(free, order))
    assert (told.look_id, told.code, told.problems) == (order.look_id, "", {}), told.message
    assert set(told.values) == {"volume_ul", "port_index", "is_initialized"}
    assert 0 < told.took_s < 10
    assert pump.moves == []


def test_a_line_that_is_served_is_left_alone(host: Host, pump: PumpProcess) -> None:
    told = looked(host, *parts_of(host, an_order(host)))
    assert (told.code, told.values) == ("look.line_served", {})
    assert "Pump" in told.message
    assert pump.moves == []


def test_where_nobody_answers_it_says_so(free: Host) -> None:
    told = looked(free, *parts_of(free, an_order(free, transport="tcp://127.0.0.1:9")))
    assert told.code.startswith("device.")
    assert told.values == {}


def test_a_look_gives_way_when_its_line_is_to_be_served(free: Host) -> None:
    with socket.create_server(("127.0.0.1", 0)) as mute:
        url = f"tcp://127.0.0.1:{mute.getsockname()[1]}"
        heard: list[socket.socket] = []

        def admit() -> None:
            heard.append(mute.accept()[0])
            journal = Journal(free.path)
            open_session(journal, free.server.welcome(a_device(url)))
            journal.close()

        admitting = threading.Thread(target=admit)
        admitting.start()
        told = looked(free, *parts_of(free, an_order(free, transport=url)))
        admitting.join(20)
        heard[0].close()
    assert told.code == "look.line_served"


@pytest.mark.parametrize("wrong", ["signer", "host", "epoch", "look", "digest", "approval"])
def test_what_the_server_did_not_sign_for_here_and_now_opens_nothing(
    free: Host, pump: PumpProcess, wrong: str
) -> None:
    changes: dict[str, dict[str, Any]] = {
        "host": {"host_id": uuid4()},
        "epoch": {"epoch": free.server.epoch - 1},
        "digest": {"digest": "0" * 64},
    }
    order = an_order(free, **changes.get(wrong, {}))
    first, rest = parts_of(free, order, Server() if wrong == "signer" else None)
    if wrong == "look":
        other = uuid4()
        first, rest = (msgspec.structs.replace(one, look_id=other) for one in (first, rest))
    if wrong == "approval":
        first = msgspec.structs.replace(first, approval=None)
    told = looked(free, first, rest)
    assert told.code in {"look.unsigned", "driver.unsigned", "driver.digest"}
    assert pump.moves == []


def test_a_piece_that_is_missing_ends_it(free: Host) -> None:
    _, rest = parts_of(free, an_order(free))
    assert looked(free, rest).code == "driver.bundle"


def test_a_machine_that_cannot_confine_looks_at_nothing(
    free: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(device_look, "is_possible", lambda: False)
    assert looked(free, *parts_of(free, an_order(free))).code == "look.unconfined"
