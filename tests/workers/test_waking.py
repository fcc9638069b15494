"""How a line hears that it has something to do."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from celery import Celery

from workers import waking
from workers.config import line_queue
from workers.store import Store
from workers.waking import attend, waker

LINE = "serial:/dev/line"


@pytest.fixture
def wake_line(
    store: Store, valkey_socket: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], None]:
    """What accept and uplink wake a line with; a message lies in the queue of its worker."""
    monkeypatch.setattr(waking, "LISTENS_S", 0.3)
    broker = f"redis+socket://{valkey_socket}?virtual_host=0"
    return waker(Celery("host", broker=broker, set_as_current=False, fixups=[]), store)


def test_a_line_that_sleeps_is_sent_a_message(
    store: Store, wake_line: Callable[[str], None]
) -> None:
    wake_line(LINE)
    assert store.queue_length(line_queue(LINE)) == 1


def test_a_line_that_listens_drains_again_for_each_word_and_gets_no_message(
    store: Store, wake_line: Callable[[str], None]
) -> None:
    drains: list[int] = []

    def drain() -> None:
        drains.append(len(drains))
        if len(drains) in {2, 3}:
            threading.Timer(0.05, wake_line, (LINE,)).start()

    attend(store, LINE, drain, lambda: False)
    assert (len(drains), store.queue_length(line_queue(LINE))) == (5, 0)
    assert not store.ring_line(LINE), "nobody listens any more"


def test_what_comes_before_it_listens_is_found_without_the_message(
    store: Store, wake_line: Callable[[str], None]
) -> None:
    """The worker takes no message before it returns: it has to look once it listens."""
    waiting = ["first"]
    done: list[str] = []

    def drain() -> None:
        done.extend(waiting)
        waiting.clear()
        if done == ["first"]:
            waiting.append("second")
            wake_line(LINE)

    attend(store, LINE, drain, lambda: bool(done))
    assert done == ["first", "second"]
    assert store.queue_length(line_queue(LINE)) == 1


def test_a_line_that_ends_listens_no_longer(store: Store) -> None:
    drains: list[int] = []
    attend(store, LINE, lambda: drains.append(0), lambda: True)
    assert len(drains) == 3


def test_without_valkey_it_drains_and_returns(tmp_path: Path) -> None:
    store = Store(f"unix://{tmp_path / 'nothing'}?db=0")
    drains: list[int] = []
    attend(store, LINE, lambda: drains.append(0), lambda: False)
    assert len(drains) == 3
    assert not store.ring_line(LINE)
