"""The dispatcher's loop around the database: who leads, and what becomes of it after a failure."""

from __future__ import annotations

import threading

import pytest
from django.db import connection

from labweb.runs.management.commands.dispatcher import Command, close_connections


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
        assert command._is_leader(), "its own lock, left in the pool, keeps it out"
    finally:
        close_connections()


@pytest.mark.django_db(transaction=True)
def test_one_dispatcher_leads_and_the_next_takes_over_when_it_ends() -> None:
    leads: list[bool] = []

    def ask() -> None:
        leads.append(Command()._is_leader())
        connection.close()

    try:
        assert Command()._is_leader()
        for _ in range(2):
            thread = threading.Thread(target=ask)
            thread.start()
            thread.join()
            close_connections()
        assert leads == [False, True]
    finally:
        close_connections()
