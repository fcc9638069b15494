"""The dispatcher's bell: rung at commit, never for what was taken back, and only a help."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

import pytest
from django.db import connection, connections
from django.db.transaction import atomic

from labweb.common import dispatcher_wakeup
from labweb.common.dispatcher_wakeup import Listener, wake_dispatcher
from labweb.fleet.management.commands import dispatcher
from labweb.runs.models import Attempt, Outbox
from tests.builders import a_lab, a_started_run, an_edge, dispatched

pytestmark = pytest.mark.django_db(transaction=True)

LONG_S = 20.0


@pytest.fixture
def listener() -> Iterator[Listener]:
    made = Listener()
    assert made.wait(0.0), "what was rung before it listened may be lost, so it says to look"
    yield made
    made.close()


def test_the_bell_rings_when_a_transaction_has_committed_and_once(listener: Listener) -> None:
    with atomic():
        wake_dispatcher()
        wake_dispatcher()
        assert not listener.wait(0.05)
    assert listener.wait(LONG_S)
    assert not listener.wait(0.05)


def test_what_was_rolled_back_rings_nothing(listener: Listener) -> None:
    def give_up() -> None:
        with atomic():
            wake_dispatcher()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        give_up()
    assert not listener.wait(0.05)


def test_a_run_that_starts_an_end_that_comes_and_a_host_that_is_there_ring(
    listener: Listener,
) -> None:
    bench = a_lab()
    run = a_started_run(bench)
    assert listener.wait(LONG_S), "a run was started"
    edge = an_edge(bench)
    assert listener.wait(LONG_S), "its host is online"
    attempt = dispatched(run)
    while listener.wait(0.05):
        pass
    edge.report("accepted", attempt.id)
    assert not listener.wait(0.05), "progress leaves nothing to dispatch"
    edge.complete(attempt)
    assert listener.wait(LONG_S), "what comes after it may go"


def test_a_listener_whose_connection_broke_listens_again(listener: Listener) -> None:
    assert listener._connection is not None
    pid = listener._connection.info.backend_pid
    with connection.cursor() as cursor:
        cursor.execute("SELECT pg_terminate_backend(%s, 5000)", [pid])
    assert not listener.wait(0.01)
    assert listener.wait(0.01), "it has a new connection, and may have missed something"
    wake_dispatcher()
    assert listener.wait(LONG_S)


def _works_through(made: Callable[[], object]) -> float:
    """Let a dispatcher run while something is made; return s until the host was rung."""
    stop = threading.Event()

    def work() -> None:
        try:
            dispatcher.Command().work(stop)
        finally:
            connections.close_all()

    thread = threading.Thread(target=work)
    thread.start()
    try:
        time.sleep(0.5)
        made()
        began_s = time.monotonic()
        while not Outbox.objects.filter(published_at__isnull=False).exists():
            assert time.monotonic() - began_s < LONG_S, "nothing was sent"
            time.sleep(0.005)
        return time.monotonic() - began_s
    finally:
        stop.set()
        wake_dispatcher()
        thread.join(LONG_S)
        assert not thread.is_alive()


def test_a_bell_that_was_lost_costs_a_tick_and_nothing_else(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dispatcher_wakeup, "CHANNEL", "nobody_listens_here")
    heard = Listener()
    assert heard.wait(0.0)
    monkeypatch.setattr(dispatcher_wakeup, "CHANNEL", "somewhere_else")
    monkeypatch.setattr(dispatcher_wakeup, "Listener", lambda: heard)
    bench = a_lab()
    an_edge(bench)
    _works_through(lambda: a_started_run(bench))
    assert Attempt.objects.count() == 1


def test_with_a_bell_the_tick_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatcher, "_TICK_S", LONG_S)
    bench = a_lab()
    an_edge(bench)

    assert _works_through(lambda: a_started_run(bench)) < LONG_S / 2
