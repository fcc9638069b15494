"""Rooms of a test's own in servers that others use too: a database, a Redis number, a vhost.

Each room is empty when it is entered and gone when it is left, so that runs beside each other
and runs after each other do not see each other's rows, keys and messages.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from secrets import token_hex
from urllib.parse import quote, unquote, urlsplit, urlunsplit

import psycopg
from psycopg import sql
from psycopg.conninfo import conninfo_to_dict
from redis import Redis

from deploy.embedded import external

_CLAIM = "labweb:tests:claimed"
_CLAIM_S = 3 * 3600
"""A run that was killed holds its number for so long."""

_RABBITMQCTL_S = 60.0


class NoRoomError(Exception):
    """A server that gives a test no room of its own; the message says what to do."""


@contextmanager
def rooms(given: Mapping[str, str]) -> Iterator[dict[str, str]]:
    """Enter a room in each of the given servers, and yield their addresses."""
    enter = {external.DATABASE: own_database, external.REDIS: own_redis, external.AMQP: own_vhost}
    with ExitStack() as stack:
        yield {name: stack.enter_context(enter[name](url)) for name, url in given.items()}


@contextmanager
def own_database(url: str) -> Iterator[str]:
    """Create a database on the server of the address, and drop it after."""
    name = f"labweb_test_{token_hex(6)}"
    with _administer(url) as connection:
        connection.execute(sql.SQL("CREATE DATABASE {}").format(sql.Identifier(name)))
    try:
        yield with_database(url, name)
    finally:
        drop_database(url, name)


def drop_database(url: str, name: str) -> None:
    """Drop a database of the server, whoever is still connected to it."""
    with _administer(url) as connection:
        statement = sql.SQL("DROP DATABASE IF EXISTS {} WITH (FORCE)")
        connection.execute(statement.format(sql.Identifier(name)))


def with_database(url: str, name: str) -> str:
    """Give the address of another database on the same server, as a URL."""
    parts = conninfo_to_dict(url) | {"dbname": name}
    query = "&".join(f"{key}={quote(str(value), safe='')}" for key, value in parts.items())
    return f"postgresql://?{query}"


def _administer(url: str) -> psycopg.Connection[tuple[object, ...]]:
    return psycopg.connect(with_database(url, "postgres"), autocommit=True, connect_timeout=5)


@contextmanager
def own_redis(url: str) -> Iterator[str]:
    """Claim an empty database number of the server, and empty it after.

    Raises:
        NoRoomError: Every other number is in use.
    """
    parts = urlsplit(url)
    if parts.query or parts.scheme == "unix":
        raise NoRoomError("the tests need a REDIS_URL such as redis://127.0.0.1:6379/0")
    taken = parts.path.removeprefix("/") or "0"
    with Redis.from_url(url) as client:
        count = int(client.config_get("databases")["databases"])
    for number in range(count - 1, -1, -1):
        if str(number) == taken:
            continue
        mine = urlunsplit(parts._replace(path=f"/{number}"))
        with Redis.from_url(mine) as client:
            if client.dbsize() or not client.set(_CLAIM, "1", nx=True, ex=_CLAIM_S):
                continue
            try:
                yield mine
            finally:
                client.flushdb()
            return
    raise NoRoomError(
        f"every database of the Redis at {parts.hostname}:{parts.port} but {taken} holds keys"
    )


@contextmanager
def own_vhost(url: str) -> Iterator[str]:
    """Add a virtual host to the RabbitMQ of this machine, and delete it after.

    Raises:
        NoRoomError: Only RabbitMQ's own administrator may do that.
    """
    name = f"labweb-test-{token_hex(6)}"
    parts = urlsplit(url)
    _rabbitmqctl("add_vhost", name)
    try:
        user = unquote(parts.username or "guest")
        _rabbitmqctl("set_permissions", "-p", name, user, ".*", ".*", ".*")
        yield urlunsplit(parts._replace(path=f"/{name}"))
    finally:
        _rabbitmqctl("delete_vhost", name)


def _rabbitmqctl(*arguments: str) -> None:
    program = shutil.which("rabbitmqctl", path="/usr/sbin:/usr/local/sbin:/usr/bin:/usr/local/bin")
    if program is None:
        raise NoRoomError(
            "the tests need a virtual host of their own, and rabbitmqctl, which adds it, is not "
            "on this machine: unset AMQP_URL to run them on Redis alone"
        )
    done = subprocess.run(
        [program, "--quiet", *arguments],
        capture_output=True,
        text=True,
        timeout=_RABBITMQCTL_S,
        check=False,
    )
    if done.returncode != 0:
        said = " ".join((done.stderr or done.stdout).split())[:300]
        raise NoRoomError(f"rabbitmqctl {arguments[0]} failed, which needs root: {said}")
