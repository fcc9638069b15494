"""The process of one line, at its end."""

from __future__ import annotations

import resource
import signal
import threading
from pathlib import Path
from uuid import uuid4

from labweb.domain.messages.stops import StopLabFrame
from tests.workers.bench import HOST_ID, Host, PumpProcess, a_do, until
from workers.base.config import HostConfig, ValkeyConfig
from workers.line.line_process import LineProcess, StopWatch
from workers.uplink.session import latch_stop

EVERY_S = 0.01


def a_line(host: Host, valkey_socket: Path, stop_grace_s: float = 2.0) -> LineProcess:
    config = HostConfig(
        host_id=HOST_ID,
        name="bench",
        server_url="ws://127.0.0.1:1",
        data_dir=str(host.folder),
        key_file=str(host.folder / "host.key"),
        valkey=ValkeyConfig(socket=str(valkey_socket)),
        stop_grace_s=stop_grace_s,
    )
    line = LineProcess(config, host.line)
    line.start()
    (unit,) = line.units.values()
    until(lambda: unit.is_online)
    return line


def test_signals_while_the_wire_is_let_go_of_wait_for_nothing(
    host: Host, valkey_socket: Path
) -> None:
    line = a_line(host, valkey_socket)
    (unit,) = line.units.values()
    begun: list[bool] = []

    def again(*_: object) -> None:
        begun.append(line.is_released)
        line.release()

    before = signal.signal(signal.SIGALRM, again)
    try:
        signal.setitimer(signal.ITIMER_REAL, EVERY_S, EVERY_S)
        line.release()
        until(lambda: begun)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert any(begun)
    assert not unit.driver.transport.is_open


def test_a_line_that_makes_room_halts_what_acts_once_its_host_is_told_to_end(
    host: Host, pump: PumpProcess, valkey_socket: Path
) -> None:
    pump.tell("slow 200")
    line = a_line(host, valkey_socket, stop_grace_s=0.1)
    do = a_do(host.server)
    host.take(do)

    def end() -> None:
        until(lambda: pump.moves)
        line.leave()
        line.close()

    thread = threading.Thread(target=end)
    thread.start()
    line.drain()
    thread.join()
    line.release()
    assert host.kinds(do.action_id)[-1] == "aborted"
    assert host.last(do.action_id)["code"] == "device.stopped"


def test_the_stop_latch_is_looked_at_again_once_a_file_can_be_opened(
    host: Host, pump: PumpProcess, valkey_socket: Path
) -> None:
    """A process that begins while it may open no more files halts its devices and goes on."""
    line = a_line(host, valkey_socket)
    (unit,) = line.units.values()
    line._watch.stop()
    late = line._watch._late
    watch = StopWatch(line._config, line.name, line.units, line._closing, late)
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, before[1]))  # 0 to 2 are taken
    try:
        watch.start()
        until(lambda: unit.driver.is_stopped)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    until(lambda: not unit.driver.is_stopped)
    latch_stop(host.journal, StopLabFrame(stop_id=uuid4(), issued_by="ada"))
    until(lambda: unit.driver.is_stopped)
    watch.stop()
    line.release()
