"""Reads that belong together."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from django.db import connection
from django.db.transaction import atomic


@contextmanager
def one_moment() -> Iterator[None]:
    """Let every read inside see the database as it was at one instant.

    A run and its jobs change in one transaction but are read by several queries: without
    this, a page could show a paused run in which nothing is in doubt. Inside a block of the
    caller's own, that block decides.
    """
    if connection.in_atomic_block:
        yield
        return
    with atomic():
        with connection.cursor() as cursor:
            cursor.execute("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ READ ONLY")
        yield
