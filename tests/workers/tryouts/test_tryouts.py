"""Source that nobody approved is tried on a simulated instrument, and reaches nothing else."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from uuid import uuid4

import msgspec
import pytest

from drivers.catalog.bundle import gather
from drivers.catalog.source import path_of, read_source
from drivers.load import read_spec
from labweb.domain.enrollment.driver_bundle import digest_of, encode_bundle
from labweb.domain.messages.driver_tryouts import TryoutAsk, TryoutOrder, TryoutPart, TryoutTold
from tests.workers.bench import HOST_ID, ROOT, Host, Server, until
from tests.workers.sandbox.test_confinement import a_config, confining
from tests.workers.tryouts.test_simulated_models import CHOSEN
from workers.base.valkey_store import TRYOUT_TOLD, TRYOUT_WORDS, ValkeyStore
from workers.journal.journal import Journal
from workers.sandbox import confinement
from workers.tryouts import tryout as tryouts
from workers.tryouts import tryout_service as services
from workers.tryouts.tryout_service import StoredTryoutOffer, TryoutService

pytestmark = confining

LOOP = "drivers.processing.lauda_loop"
PH = "drivers.sensors.seeed_ph"
SIGNALS_ABI = 6
"""From this version on Landlock bounds signals."""


class Tried:
    """One tryout as the server sees it, over the words that the uplink hands on."""

    def __init__(self, store: ValkeyStore, server: Server, module: str, **changes: Any) -> None:  # noqa: ANN401 - any field
        self.store, self.server = store, server
        self.modules = changes.pop("modules", None) or gather(read_source(path_of(module)))
        known = TryoutOrder(
            tryout_id=uuid4(),
            host_id=HOST_ID,
            epoch=server.epoch,
            digest=digest_of(self.modules),
            class_name=read_spec(module).class_name,
            config={},
            model=module.rpartition(".")[2],
            settings={},
            speed=50.0,
            asked_by="1",
        )
        self.order = msgspec.structs.replace(known, **changes)
        self.told: list[TryoutTold] = []
        self.number = 0

    def begin(self, signer: Server | None = None) -> None:
        part = TryoutPart(
            tryout_id=self.order.tryout_id,
            index=0,
            count=1,
            data=encode_bundle(self.modules),
            order=(signer or self.server).sign(self.order),
        )
        self.store.put_word(TRYOUT_WORDS, msgspec.json.encode(part))

    def ask(self, sort: Any, name: str = "", within_s: float = 20.0, **args: Any) -> TryoutTold:  # noqa: ANN401 - JSON
        number = self.send(sort, name, within_s, **args)
        return self.wait(lambda one: one.number == number)

    def send(self, sort: Any, name: str = "", within_s: float = 20.0, **args: Any) -> int:  # noqa: ANN401 - JSON
        self.number += 1
        ask = TryoutAsk(
            tryout_id=self.order.tryout_id,
            number=self.number,
            sort=sort,
            name=name,
            args=args,
            within_s=within_s,
        )
        self.store.put_word(TRYOUT_WORDS, msgspec.json.encode(ask))
        return self.number

    def wait(self, is_it: Callable[[TryoutTold], bool]) -> TryoutTold:
        def look() -> bool:
            texts = self.store.take_words(TRYOUT_TOLD)
            self.told += [msgspec.json.decode(text, type=TryoutTold) for text in texts]
            return any(is_it(one) for one in self.told)

        until(look, within_s=30.0)
        return next(one for one in self.told if is_it(one))

    def started(self) -> TryoutTold:
        self.begin()
        return self.wait(lambda one: one.state in {"running", "ended"})

    def wire(self) -> bytes:
        records = [record for one in self.told for record in one.wire]
        assert [one.n for one in records] == sorted(one.n for one in records)
        return b"".join(bytes.fromhex(one.hex) for one in records if one.direction == "in")


@pytest.fixture
def offer(host: Host, store: ValkeyStore) -> Iterator[StoredTryoutOffer]:
    """A host whose service runs."""
    loop = asyncio.new_event_loop()
    running: list[asyncio.Task[None]] = []

    def run() -> None:
        journal = Journal(host.path)
        running.append(loop.create_task(TryoutService(a_config(host.folder), journal, store).run()))
        with contextlib.suppress(asyncio.CancelledError):
            loop.run_until_complete(running[0])
        journal.close()

    thread = threading.Thread(target=run)
    thread.start()
    until(store.tryout_offer, within_s=30.0)
    yield msgspec.json.decode(store.tryout_offer(), type=StoredTryoutOffer)
    loop.call_soon_threadsafe(running[0].cancel)
    thread.join(20)
    assert not thread.is_alive()
    loop.close()


def test_a_driver_is_driven_watched_and_disturbed(
    host: Host, store: ValkeyStore, offer: StoredTryoutOffer
) -> None:
    assert "lauda_loop" in {one.model for one in offer.models}
    tried = Tried(store, host.server, LOOP, config={"settle_s": 0.0})
    assert tried.started().state == "running", tried.told
    read = tried.ask("read")
    assert read.data["problems"] == {}
    assert read.data["values"]["temperature_c"] == pytest.approx(22, abs=1)
    number = tried.send("act", "reach_temperature", temperature_c=25.0, tolerance_c=0.5)
    second = tried.ask("act", "stop_control")
    assert second.code == "tryout.acting"
    done = tried.wait(lambda one: one.number == number)
    assert (done.code, done.data["evidence"] != {}) == ("", True)
    assert b"OUT_SP_00" in tried.wire()
    faulty = tried.ask("fault", "no_answer")
    assert faulty.faults == ["no_answer"]
    silent = tried.ask("read")
    assert silent.code or silent.data["problems"]
    assert tried.ask("cure").faults == []
    assert tried.ask("read").data["values"]["temperature_c"] == pytest.approx(25, abs=2)
    unknown = tried.ask("fault", "no_such_fault")
    assert unknown.code == "tryout.fault"
    tried.send("end")
    assert tried.wait(lambda one: one.state == "ended").message == "its author ended it"


def test_a_line_that_was_unplugged_is_found_again(
    host: Host, store: ValkeyStore, offer: StoredTryoutOffer
) -> None:
    assert offer.problem == ""
    tried = Tried(store, host.server, LOOP, config={"settle_s": 0.0})
    assert tried.started().state == "running"
    assert tried.ask("read").data["problems"] == {}
    assert tried.ask("fault", "unplug").faults == ["unplug"]
    unplugged = tried.ask("read")
    assert unplugged.code or unplugged.data["problems"]
    tried.ask("cure")
    assert tried.ask("read").data["problems"] == {}


def test_registers_are_reached_over_their_own_sort_of_line(
    host: Host, store: ValkeyStore, offer: StoredTryoutOffer
) -> None:
    assert offer.problem == ""
    tried = Tried(store, host.server, PH, model="modbus_ph", settings={"device_id": 7})
    assert tried.started().state == "running", tried.told
    assert tried.ask("read").data["values"]["value_ph"] == pytest.approx(7.0, abs=0.2)


@pytest.mark.parametrize(
    ("module", "settings"),
    [
        ("logistics.seer_agv", {}),
        ("processing.s7_furnace", {}),
        ("processing.sila_temperature_controller", {"insecure": False}),
    ],
)
def test_an_instrument_is_reached_by_more_than_its_port(
    host: Host, store: ValkeyStore, offer: StoredTryoutOffer, module: str, settings: dict[str, Any]
) -> None:
    wanted = CHOSEN[module]
    assert wanted.model in {one.model for one in offer.models}
    tried = Tried(
        *(store, host.server, f"drivers.{module}"),
        model=wanted.model,
        config=wanted.config,
        settings=settings,
    )
    assert tried.started().state == "running", tried.told
    read = tried.ask("read")
    assert (read.code, read.data["problems"]) == ("", {}), read


@pytest.mark.parametrize("carrier", ["serial", "tcp"])
def test_source_that_nobody_approved_reaches_its_line_and_nothing_else(
    tmp_path: Path, carrier: str
) -> None:
    secret = tmp_path / "host.key"
    secret.write_text("secret")
    terminal, own = os.openpty()
    with (
        socket.create_server(("127.0.0.1", 0)) as line,
        socket.create_server(("127.0.0.1", 0)) as other,
    ):
        url = f"tcp://127.0.0.1:{line.getsockname()[1]}"
        if carrier == "serial":
            url = f"serial://{os.ttyname(own)}"
        words = [url, str(secret), str(other.getsockname()[1])]
        done = subprocess.run(
            [sys.executable, "-m", "tests.workers.tryouts.tryout_probe", *words],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
    os.close(terminal)
    os.close(own)
    assert done.returncode == 0, done.stderr
    found: dict[str, bool] = json.loads(done.stdout)
    works = {name for name, is_open in found.items() if is_open}
    if confinement.landlock_abi() < SIGNALS_ABI:
        works -= {"signal to its parent"}
    assert works == {"own line", "thread"}
    assert len(found) > 10


def test_source_that_breaks_a_rule_is_not_run_at_all(
    host: Host, store: ValkeyStore, offer: StoredTryoutOffer
) -> None:
    assert offer.problem == ""
    texts = gather(read_source(path_of(LOOP)))
    worse = {**texts, LOOP: f"{texts[LOOP]}\nopen('/etc/passwd')\n"}
    refused = Tried(store, host.server, LOOP, modules=worse).started()
    assert (refused.state, refused.code) == ("ended", "driver.conformance")


@pytest.mark.parametrize("wrong", ["signer", "host", "epoch", "digest"])
def test_an_order_that_the_server_did_not_sign_for_here_and_now_begins_nothing(
    host: Host, store: ValkeyStore, offer: StoredTryoutOffer, wrong: str
) -> None:
    assert offer.problem == ""
    changes: dict[str, dict[str, Any]] = {
        "host": {"host_id": uuid4()},
        "epoch": {"epoch": host.server.epoch - 1},
        "digest": {"digest": "0" * 64},
    }
    tried = Tried(store, host.server, LOOP, **changes.get(wrong, {}))
    tried.begin(Server() if wrong == "signer" else None)
    told = tried.wait(lambda one: one.state == "ended")
    assert told.code in {"tryout.unsigned", "driver.digest"}


def test_settings_that_do_not_fit_end_it_with_every_finding(
    host: Host, store: ValkeyStore, offer: StoredTryoutOffer
) -> None:
    assert offer.problem == ""
    tried = Tried(store, host.server, LOOP, settings={"no_such": 1})
    ended = tried.started()
    assert (ended.state, ended.code) == ("ended", "tryout.settings")
    assert "no_such" in ended.message


def test_it_ends_by_itself_when_nobody_asks_anything(
    host: Host, store: ValkeyStore, offer: StoredTryoutOffer, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert offer.problem == ""
    monkeypatch.setattr(tryouts, "IDLE_S", 1.0)
    tried = Tried(store, host.server, LOOP)
    assert tried.started().state == "running"
    ended = tried.wait(lambda one: one.state == "ended")
    assert "nobody has asked" in ended.message


def test_a_machine_that_cannot_confine_offers_nothing(
    host: Host, store: ValkeyStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(services, "is_possible", lambda: False)
    service = TryoutService(a_config(host.folder), host.journal, store)
    found = asyncio.run(service._offer())
    assert (found.models, "confine" in found.problem) == ([], True)
