"""Ask servers of the person's own whether a lab can use them.

Run as ``python -m deploy.embedded.reach``: the addresses are in the environment, where other
users of the machine cannot read a password, and the answer is one JSON object.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from urllib.parse import parse_qsl, unquote, urlsplit

import psycopg
from amqp.exceptions import AMQPError
from kombu import Connection
from kombu.exceptions import KombuError
from psycopg.conninfo import conninfo_to_dict
from redis import Redis
from redis.connection import parse_url
from redis.exceptions import NoPermissionError, RedisError

from deploy.embedded.external import AMQP, DATABASE, REDIS, given_urls

TIMEOUT_S = 3
OLDEST_POSTGRESQL = 15
OLDEST_REDIS = 7
Answer = dict[str, str | bool]
"""Fields of `external.Found`, or the one field ``error``."""

_OURS = ("resources", "enrollment", "crutd")
"""Apps of which one at least has migrated in a database that labweb has begun to fill."""

_STATE = """
SELECT current_setting('server_version'),
       (SELECT system_identifier::text FROM pg_control_system()),
       (SELECT oid::text FROM pg_database WHERE datname = current_database()),
       EXISTS (SELECT FROM pg_class WHERE relkind IN ('r', 'p')
                  AND relnamespace = current_schema()::regnamespace),
       to_regclass('django_migrations') IS NOT NULL
"""


class UnusableError(Exception):
    """A server that the lab cannot use. The text holds no password."""


@dataclass(frozen=True, slots=True)
class _Place:
    text: str
    secret: str

    def fail(self, why: object) -> UnusableError:
        """Say why, on one line and without the password."""
        words = " ".join(str(why).split()).rstrip(".?")
        for secret in filter(None, {self.secret, unquote(self.secret)}):
            words = words.replace(secret, "***")
        return UnusableError(f"{self.text} cannot be used: {words or type(why).__name__}.")


def postgresql(url: str) -> Answer:
    """Sign in to a database and see to it that it is empty or labweb's own.

    Raises:
        UnusableError: It is away, refuses, is too old, or holds other tables.
    """
    example = "postgresql://user@host:5432/name"
    try:
        parts = conninfo_to_dict(url)
    except psycopg.ProgrammingError:
        # libpq's own words would quote the address with its password.
        raise UnusableError(f"this is no address of PostgreSQL, such as {example}.") from None
    for part, word in (("dbname", "database"), ("user", "user")):
        if not parts.get(part):
            raise UnusableError(f"the address names no {word}; write it as {example}.")
    host = parts.get("host") or parts.get("hostaddr") or "local"
    text = f"{host}:{parts.get('port') or 5432}/{parts['dbname']}"
    place = _Place(text, str(parts.get("password") or ""))
    try:
        with psycopg.connect(url, connect_timeout=TIMEOUT_S) as connection:
            connection.execute(f"SET statement_timeout = '{TIMEOUT_S}s'")
            row = connection.execute(_STATE).fetchone() or ()
            version, cluster, number, has_tables, has_history = row
            if connection.info.server_version < OLDEST_POSTGRESQL * 10_000:
                raise place.fail(f"labweb needs PostgreSQL {OLDEST_POSTGRESQL}, this is {version}")
            if has_tables and not (has_history and _is_ours(connection)):
                raise place.fail("it holds tables that are not labweb's; give the lab an empty one")
    except psycopg.Error as error:
        raise place.fail(error) from None
    return {
        "place": text,
        "version": version.split()[0],
        "identity": f"{cluster}/{number}",
        "is_empty": not has_tables,
    }


def _is_ours(connection: psycopg.Connection[tuple[object, ...]]) -> bool:
    query = "SELECT EXISTS (SELECT FROM django_migrations WHERE app = ANY(%s))"
    return connection.execute(query, [list(_OURS)]).fetchone() == (True,)


def redis(url: str) -> Answer:
    """Sign in to a Redis or Valkey.

    Raises:
        UnusableError: It is away, refuses, or is too old.
    """
    example = "redis://host:6379/0, rediss://… or unix:///path?db=0"
    try:
        parts = urlsplit(url)
        options = parse_url(url)  # type: ignore[no-untyped-call]
    except ValueError:
        raise UnusableError(f"this is no address of Redis, such as {example}.") from None
    host = options.get("path") or f"{options.get('host', 'localhost')}:{options.get('port', 6379)}"
    text = f"{host}/{options.get('db', 0)}"
    secret = parts.password or dict(parse_qsl(parts.query)).get("password", "")
    place = _Place(text, secret)
    timeouts = {"socket_timeout": TIMEOUT_S, "socket_connect_timeout": TIMEOUT_S}
    try:
        with Redis.from_url(url, **timeouts) as client:
            client.exists("labweb")
            version = _redis_version(client)
    except (RedisError, OSError) as error:
        raise place.fail(error) from None
    if version and int(version.split(".")[0]) < OLDEST_REDIS:
        raise place.fail(f"labweb needs Redis or Valkey {OLDEST_REDIS}, this is {version}")
    return {"place": text, "version": version or "not told"}


def _redis_version(client: Redis) -> str:
    try:
        return str(client.info("server")["redis_version"])
    except NoPermissionError:
        return ""


def rabbitmq(url: str) -> Answer:
    """Sign in to a virtual host.

    Raises:
        UnusableError: It is away or refuses.
    """
    example = "amqp://user@host:5672/vhost"
    try:
        parts = urlsplit(url)
        port = parts.port or (5671 if parts.scheme == "amqps" else 5672)
    except ValueError:
        raise UnusableError(f"this is no address of RabbitMQ, such as {example}.") from None
    if parts.scheme not in {"amqp", "amqps"} or not parts.hostname:
        raise UnusableError(f"this is no address of RabbitMQ, such as {example}.")
    vhost = unquote(parts.path.removeprefix("/")) or "/"
    place = _Place(f"{parts.hostname}:{port}, virtual host {vhost}", parts.password or "")
    try:
        with Connection(url, connect_timeout=TIMEOUT_S) as connection:
            inner = connection.transport.establish_connection()
            version = str(inner.server_properties.get("version", "not told"))
            inner.close()
    except (AMQPError, KombuError, OSError) as error:
        raise place.fail(error) from None
    return {"place": place.text, "version": version}


ASK: dict[str, Callable[[str], Answer]] = {
    DATABASE: postgresql,
    REDIS: redis,
    AMQP: rabbitmq,
}


def main() -> None:
    """Ask all servers of the environment at the same time."""
    given = given_urls()
    with ThreadPoolExecutor(len(ASK)) as pool:
        futures = {name: pool.submit(_answer, name, url) for name, url in given.items()}
        answers = {name: future.result() for name, future in futures.items()}
    sys.stdout.write(json.dumps(answers) + "\n")


def _answer(name: str, url: str) -> Answer:
    try:
        return ASK[name](url)
    except UnusableError as error:
        return {"error": str(error)}


if __name__ == "__main__":
    main()
