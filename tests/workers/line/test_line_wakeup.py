"""How a line hears that it has something to do."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from celery import Celery

from workers.base.config import line_queue
from workers.base.valkey_store import ValkeyStore
from workers.base.wake_pipe import hang, ring
from workers.line import line_wakeup
from workers.line.line_wakeup import attend, waker

LINE = "serial:/dev/line"


@pytest.fixture
def bell(tmp_path: Path) -> Path:
    """Return where the line's bell hangs."""
    hang(tmp_path / "bell")
    return tmp_path / "bell"


@pytest.fixture
def wake_line(
    bell: Path, valkey_socket: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], None]:
    """What accept and uplink wake a line with; a message lies in the queue of its worker."""
    monkeypatch.setattr(line_wakeup, "LISTENS_S", 0.3)
    broker = f"redis+socket://{valkey_socket}?virtual_host=0"
    return waker(Celery("host", broker=broker, set_as_current=False, fixups=[]), lambda _line: bell)


def test_a_line_that_sleeps_is_sent_a_message(
    store: ValkeyStore, wake_line: Callable[[str], None]
) -> None:
    wake_line(LINE)
    assert store.queue_length(line_queue(LINE)) == 1


def test_a_line_that_listens_drains_again_for_each_ring_and_gets_no_message(
    store: ValkeyStore, bell: Path, wake_line: Callable[[str], None]
) -> None:
    drains: list[int] = []

    def drain() -> None:
        drains.append(len(drains))
        if len(drains) in {2, 3}:
            threading.Timer(0.05, wake_line, (LINE,)).start()

    attend(bell, drain, lambda: False)
    assert (len(drains), store.queue_length(line_queue(LINE))) == (5, 0)
    assert not ring(bell), "nobody listens any more"


def test_what_comes_before_it_listens_is_found_without_the_message(
    store: ValkeyStore, bell: Path, wake_line: Callable[[str], None]
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

    attend(bell, drain, lambda: bool(done))
    assert done == ["first", "second"]
    assert store.queue_length(line_queue(LINE)) == 1


def test_a_line_that_ends_listens_no_longer(bell: Path) -> None:
    drains: list[int] = []
    attend(bell, lambda: drains.append(0), lambda: True)
    assert len(drains) == 3


def test_where_no_bell_can_hang_the_queue_is_drained_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "bell"
    path.write_bytes(b"")
    drains: list[int] = []
    attend(path, lambda: drains.append(0), lambda: False)
    assert drains == [0], "a message wakes the line from here on"
    assert not ring(path)
    assert path.read_bytes() == b""
