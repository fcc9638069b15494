"""A Chemputer pump whose watchdog is armed, with and without somebody who keeps it quiet."""

from __future__ import annotations

import json
import shutil
import socket
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.connectors.chemputer_pump import ChemputerPump
from drivers.transports.base import ByteTransport
from drivers.transports.urls import make_transport
from labweb.domain.errors import DeviceError
from tests.fixtures.running import Process

CONFIG = {"syringe_ul": 1000.0, "max_rate_ul_s": 1000.0, "home_rate_ul_s": 1000.0}
QUIET_S = 2.5
"""Longer than the pump waits for the datagram."""


@pytest.fixture(autouse=True)
def quick() -> None:
    """This pump runs in real time: the drivers' own limits hold."""


@pytest.fixture
def armed() -> Iterator[tuple[str, int]]:
    """Start a pump that expects the datagram, and tell its address and where it listens."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        listens = free.getsockname()[1]
    process = Process(Path(tempfile.mkdtemp(prefix="lw", dir="/tmp")))
    settings = {"syringe_ul": 1000.0, "keepalive_port": listens}
    pump = {"id": "it", "model": "chemputer_pump", "endpoint": "tcp:127.0.0.1:0"}
    document = {"schema": "labweb.bench/1", "vessels": [], "instruments": [
        {**pump, "settings": settings, "attached": {}}]}  # fmt: skip
    (process.folder / "bench.json").write_text(json.dumps(document), encoding="utf-8")
    try:
        process.start("--speed", "1")
        yield f"tcp://127.0.0.1:{process.port_of('it')}", listens
    finally:
        process.stop()
        shutil.rmtree(process.folder, ignore_errors=True)


def connected(url: str) -> ChemputerPump:
    transport = make_transport(url)
    assert isinstance(transport, ByteTransport)
    pump = ChemputerPump(transport, CONFIG)
    pump.connect()
    return pump


def test_a_pump_that_is_told_that_somebody_is_there_goes_on(armed: tuple[str, int]) -> None:
    url, listens = armed
    pump = connected(f"{url}?beat=127.0.0.1:{listens}")
    try:
        pump.initialize()
        time.sleep(QUIET_S)
        assert pump.aspirate(100.0, 500.0).moved_ul == 100.0
    finally:
        pump.close()


def test_a_pump_that_is_left_alone_stops_and_says_so(armed: tuple[str, int]) -> None:
    pump = connected(armed[0])
    try:
        time.sleep(QUIET_S)
        with pytest.raises(DeviceError):
            pump.initialize()
        assert pump.is_initialized() is False
    finally:
        pump.close()
