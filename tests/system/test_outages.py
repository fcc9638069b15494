"""Servers and processes that freeze, forget or die in the middle of a run.

The run ends right or waits for a person; no motion happens twice, by the count of the simulated
instruments; no event that was acknowledged is lost on either side.
"""

from __future__ import annotations

import os
import signal
import time

import pytest
from redis import Redis

from tests.services import given_urls
from tests.system.outages import (
    Outage,
    an_outage,
    broker_sockets,
    database_answers,
    database_pid,
    frozen,
    host_pids,
)
from tests.system.stack import BROKER, Stack

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(400),
    pytest.mark.skipif(bool(given_urls()), reason="it breaks servers, and those given are others'"),
]

IS_SOAK = bool(os.environ.get("LABWEB_SOAK"))
FROZEN_S = 60.0 if IS_SOAK else 0.0
AWAY_S = 60.0 if IS_SOAK else 0.5
ANSWERS_WITHIN_S = 15.0
MISSED_AS = "isolated" if IS_SOAK else "suspect"
"""What the server has to take a frozen host for before it goes on: after 30 s, or after 10 s."""


def test_a_host_that_is_frozen_is_missed_and_goes_on(stack: Stack) -> None:
    """All its processes, in the middle of a stroke; the pump ends its stroke meanwhile."""
    with an_outage(stack), frozen(host_pids(stack)):
        began_s = time.monotonic()
        while _state_of_host(stack) != MISSED_AS or time.monotonic() - began_s < FROZEN_S:
            assert time.monotonic() - began_s < 35.0 + FROZEN_S, _state_of_host(stack)
            time.sleep(0.2)


def _state_of_host(stack: Stack) -> str:
    return str(stack.client().get("hosts")["hosts"][0]["state"])


def test_brokers_that_forget_everything_lose_no_command(stack: Stack) -> None:
    """The server's and the host's own are flushed again and again while a run goes on."""
    with an_outage(stack):
        for _ in range(4):
            for path in broker_sockets(stack):
                with Redis(unix_socket_path=str(path)) as client:
                    client.flushall()
            time.sleep(0.4)


def test_brokers_that_are_killed_again_and_again_lose_no_command(stack: Stack) -> None:
    with an_outage(stack):
        for name in (BROKER, "host.sock", BROKER):
            stack.kill(name)
            time.sleep(1.0)


def test_a_database_that_is_stopped_at_once_loses_nothing_it_had_confirmed(stack: Stack) -> None:
    """SIGQUIT to its first process is what `pg_ctl stop -m immediate` sends.

    It cannot start again before its files are back; then the page answers as soon as it does.
    """
    files, elsewhere = stack.data / "pg", stack.data / "pg.away"
    with an_outage(stack):
        pid = database_pid(stack)
        files.rename(elsewhere)
        os.kill(pid, signal.SIGQUIT)
        time.sleep(AWAY_S)
        elsewhere.rename(files)
        _wait_for_database(stack)
        began_s = time.monotonic()
        while not stack.client().raw("GET", "hosts").is_success:
            assert time.monotonic() - began_s < ANSWERS_WITHIN_S
            time.sleep(0.1)


def _wait_for_database(stack: Stack) -> None:
    deadline_s = time.monotonic() + 60
    while not database_answers(stack):
        assert time.monotonic() < deadline_s
        time.sleep(0.1)


def test_a_server_killed_around_each_commit_sends_and_takes_everything_once(stack: Stack) -> None:
    """The dispatcher with a command committed and not sent, then with one sent and not noted.

    And web with events committed and not acknowledged: the host tells them again.
    """
    stack.fault_file.write_text("relay.before_ring:kill")
    outage = Outage(stack)
    _wait_until_met(stack)
    for point in ("relay.after_ring", "ingest.after_commit"):
        stack.fault_file.write_text(f"{point}:kill")
        _wait_until_met(stack)
    outage.judge()


def _wait_until_met(stack: Stack) -> None:
    """Wait until a process has met the fault, which it takes away before it dies of it."""
    deadline_s = time.monotonic() + 60
    while stack.fault_file.exists():
        assert time.monotonic() < deadline_s, stack.fault_file.read_text()
        time.sleep(0.02)
