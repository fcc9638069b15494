"""The dispatcher's loop around the database: who leads, and what becomes of it after a failure."""

from __future__ import annotations

import threading
import time
from functools import partial
from itertools import pairwise

import pytest
from django.db import connection
from django.db.utils import OperationalError

from labweb.fleet.management.commands.dispatcher import Command, Watch, close_connections
from tests.fixtures.running import until


def _with_another_connection() -> None:
    """Have the pool hold a second connection, as after a time of waiting."""

    def use() -> None:
        connection.ensure_connection()
        connection.close()

    thread = threading.Thread(target=use)
    thread.start()
    thread.join()


@pytest.mark.django_db(transaction=True)
def test_after_a_failure_of_the_database_the_dispatcher_leads_again() -> None:
    command = Command()
    try:
        assert command._is_leader()
        _with_another_connection()
        close_connections()
        until(command._is_leader, 10)  # a lock of its own, left in the pool, would keep it out
    finally:
        close_connections()


@pytest.mark.django_db(transaction=True)
def test_one_dispatcher_leads_and_the_next_takes_over_when_it_ends() -> None:
    leads: list[bool] = []

    def ask() -> None:
        leads.append(Command()._is_leader())
        connection.close()

    def another_leads() -> bool:
        thread = threading.Thread(target=ask)
        thread.start()
        thread.join()
        close_connections()
        return leads[-1]

    try:
        assert Command()._is_leader()
        assert not another_leads(), "one leads already; it ends its connections only after this"
        until(another_leads)  # the database ends a connection in its own time
    finally:
        close_connections()


def test_every_duty_has_its_turn_each_second_and_never_two_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    at_s = 50.0
    monkeypatch.setattr(time, "monotonic", lambda: at_s)
    watch, done = Watch(), list[tuple[float, int]]()

    def does(duty: int) -> None:
        done.append((at_s, duty))

    watch.duties = tuple(partial(does, duty) for duty in range(9))
    while at_s < 53.0:
        watch.take_turn()
        at_s += 0.05
    assert all(here[0] < then[0] for here, then in pairwise(done))
    for duty in range(9):
        turns = [at for at, which in done if which == duty]
        assert len(turns) == 3
        assert all(0.9 <= b - a <= 1.1 for a, b in pairwise(turns))


def test_a_watch_that_was_held_up_makes_up_for_one_round_and_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    at_s = 50.0
    monkeypatch.setattr(time, "monotonic", lambda: at_s)
    watch, done = Watch(), list[int]()
    watch.duties = tuple(partial(done.append, duty) for duty in range(9))
    watch.take_turn()
    at_s = 500.0
    for _ in range(30):
        watch.take_turn()
    assert len(done) == 11
    assert set(done) == set(range(9))


@pytest.mark.django_db
def test_a_duty_that_fails_keeps_no_other_from_its_turn_and_is_tried_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    at_s = 50.0
    monkeypatch.setattr(time, "monotonic", lambda: at_s)
    watch, done = Watch(), list[int]()
    tries = 0

    def fails() -> None:
        nonlocal tries
        tries += 1
        if tries < 4:
            raise KeyError("what no row should hold")
        done.append(2)

    does = [partial(done.append, duty) for duty in range(9)]
    watch.duties = (*does[:2], fails, *does[3:])
    while at_s < 55.0:
        watch.take_turn()
        at_s += 0.05
    assert {done.count(duty) for duty in (0, 1, 3, 8)} <= {5, 6}
    assert done.count(2) == tries - 3 > 0
    assert len(caplog.records) == 1, "it is said once"


def test_a_database_that_is_away_is_no_fault_of_a_duty() -> None:
    watch = Watch()

    def asks() -> None:
        raise OperationalError("away")

    watch.duties = (asks,)
    with pytest.raises(OperationalError):
        watch.take_turn()
