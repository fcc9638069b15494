"""What the server's tests share: a database, a cache of their own, a lab and its people."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from django.conf import settings
from django.db import connection
from pytest_django import DjangoDbBlocker
from redis import Redis

from labweb.common.signatures import signing
from tests.builders import Bench, a_lab
from tests.services import Services


@pytest.fixture(scope="session")
def django_db_modify_db_settings(
    services: Services, django_db_modify_db_settings_parallel_suffix: None
) -> None:
    """Start the database before pytest-django asks it for a test database."""


@pytest.fixture(scope="session", autouse=True)
def _no_session_left(django_db_setup: None, django_db_blocker: DjangoDbBlocker) -> Iterator[None]:
    """End what threads of sockets left open, so that the test database can be dropped."""
    yield
    with django_db_blocker.unblock(), connection.cursor() as cursor:
        cursor.execute(
            "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
            "WHERE datname = current_database() AND pid <> pg_backend_pid()"
        )


@pytest.fixture(scope="session", autouse=True)
def _may_be_emptied(django_db_setup: None, django_db_blocker: DjangoDbBlocker) -> None:
    """Let Django empty the tables between tests, which the record's own tables refuse."""
    guards = "SELECT tgrelid::regclass, tgname FROM pg_trigger WHERE tgname LIKE '%_no_truncate'"
    with django_db_blocker.unblock(), connection.cursor() as cursor:
        cursor.execute(guards)
        for table, name in cursor.fetchall():
            cursor.execute(f"ALTER TABLE {table} DISABLE TRIGGER {name}")


def _forget() -> None:
    """Delete this worker's keys; Django's `clear` would flush those of the others too."""
    prefix = settings.CACHES["default"]["KEY_PREFIX"]
    with Redis.from_url(settings.REDIS_URL) as client:
        for key in client.scan_iter(f"{prefix}:*"):
            client.delete(key)


@pytest.fixture(autouse=True)
def _nothing_remembered(services: Services) -> Iterator[None]:
    """Forget what throttles counted and which heads were signed, and have keys that sign."""
    signing.ensure_key()
    _forget()
    yield
    _forget()
    (settings.DATA_DIR / "heads.json").unlink(missing_ok=True)


@pytest.fixture
def bench(db: None) -> Bench:
    """The starter lab with everybody in it and every device admitted."""
    return a_lab()
