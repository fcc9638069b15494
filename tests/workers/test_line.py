"""The process of one line, at its end."""

from __future__ import annotations

import signal
from pathlib import Path

from tests.workers.bench import HOST_ID, Host, until
from workers.config import HostConfig, ValkeyConfig
from workers.line import Line

EVERY_S = 0.01


def test_signals_while_the_wire_is_let_go_of_wait_for_nothing(
    host: Host, valkey_socket: Path
) -> None:
    config = HostConfig(
        host_id=HOST_ID,
        name="bench",
        server_url="ws://127.0.0.1:1",
        data_dir=str(host.folder),
        key_file=str(host.folder / "host.key"),
        valkey=ValkeyConfig(socket=str(valkey_socket)),
    )
    line = Line(config, host.line)
    line.start()
    (unit,) = line.units.values()
    until(lambda: unit.is_online)
    told: list[bool] = []
    before = signal.signal(signal.SIGALRM, lambda *_: told.append(line.release()))
    try:
        signal.setitimer(signal.ITIMER_REAL, EVERY_S, EVERY_S)
        found = [line.release()]
        until(lambda: told)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert sorted(found + told)[-2:] == [False, True], "once, whoever begins with it"
    assert not unit.driver.transport.is_open
