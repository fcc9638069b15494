"""Servers of the person's own, which take the place of the embedded ones.

An address in the environment is the whole order: that server is not started here, and every
process of the lab is given the address.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl, unquote, urlencode, urlsplit, urlunsplit

from deploy.embedded.errors import EmbeddedError
from deploy.embedded.layout import CHECKOUT

DATABASE = "DATABASE_URL"
REDIS = "REDIS_URL"
AMQP = "AMQP_URL"
BROKER = "LABWEB_BROKER_URL"
OWNER = "LABWEB_DATABASE_OWNER_URL"
"""The same database for the owner of its tables, who alone changes them; the lab's processes
never see it."""

NAMES = {DATABASE: "PostgreSQL", REDIS: "Redis", AMQP: "RabbitMQ"}
"""What each variable gives, in the order in which they are told."""

REACH_WITHIN_S = 15.0
"""Each server has 3 s; the rest is the start of the program that asks, on a busy machine."""


@dataclass(frozen=True, slots=True)
class FoundService:
    """A server that answered."""

    name: str
    """The variable that names it."""

    place: str
    """Where it is, without user and password."""

    version: str
    identity: str = ""
    """Of a database: differs from every other one's, also of one made later under its name."""

    is_empty: bool = False
    """Of a database: no table is in it yet."""

    @property
    def line(self) -> str:
        """Say it as the person at the terminal reads it."""
        return f"{NAMES[self.name]} … {self.place} of {self.name}, version {self.version}"


def given_urls(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """List the addresses that the person has set; an empty one counts as not set."""
    found = {name: environment.get(name, "").strip() for name in NAMES}
    return {name: url for name, url in found.items() if url}


def owner_url(environment: Mapping[str, str] = os.environ) -> str:
    """Give the address of the person's database for the owner of its tables; empty: none."""
    return environment.get(OWNER, "").strip()


def role_of(database_url: str) -> str:
    """Give the role that signs in at an address; empty: the address names none.

    Example:
        >>> role_of("postgresql://labweb_app@10.0.0.5/labweb")
        'labweb_app'
    """
    return unquote(urlsplit(database_url).username or "")


def urls_for_children(given: Mapping[str, str]) -> dict[str, str]:
    """Give the addresses under the names by which labweb's processes know them."""
    found = {name: given[name] for name in (DATABASE, REDIS) if name in given}
    if AMQP in given:
        found[BROKER] = given[AMQP]
    elif REDIS in given:
        found[BROKER] = broker_url_of(given[REDIS])
    return found


def broker_url_of(redis_url: str) -> str:
    """Write the address of a Redis as Celery reads it; the database stays the same.

    Example:
        >>> broker_url_of("redis://lab@10.0.0.5:6379?db=2")
        'redis://lab@10.0.0.5:6379/2'
        >>> broker_url_of("unix:///run/redis.sock?db=2")
        'redis+socket:///run/redis.sock?virtual_host=2'
    """
    parts = urlsplit(redis_url)
    query = dict(parse_qsl(parts.query))
    database = query.pop("db", None)
    if parts.scheme == "unix":
        query["virtual_host"] = database or "0"
        text = urlencode(query, safe="/")
        return f"redis+socket://{parts.netloc}{parts.path}?{text}"
    path = parts.path if database is None else f"/{database}"
    return urlunsplit((parts.scheme, parts.netloc, path or "/0", urlencode(query, safe="/"), ""))


def reach(given: Mapping[str, str], environment: Mapping[str, str]) -> dict[str, FoundService]:
    """Ask every given server whether the lab can use it.

    A program of its own asks, so that no client library lives in the supervisor.

    Args:
        given: Addresses by variable.
        environment: What the lab's processes will have besides; it decides, for example,
            which home folder holds a password file.

    Raises:
        EmbeddedError: One cannot be used; the message names every such variable and never
            a password. Nothing was changed.
    """
    if not given:
        return {}
    try:
        done = subprocess.run(
            [sys.executable, "-m", "deploy.embedded.reach"],
            cwd=CHECKOUT,
            env={**environment, **given},
            capture_output=True,
            text=True,
            timeout=REACH_WITHIN_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise EmbeddedError(
            f"The servers of {', '.join(given)} have not answered in {REACH_WITHIN_S:g} s. "
            + _advice(given)
        ) from error
    answers = _answers(done)
    wrong = {name: answer["error"] for name, answer in answers.items() if "error" in answer}
    if wrong:
        lines = [f"{name}: {text}" for name, text in wrong.items()]
        raise EmbeddedError("\n  ".join([*lines, _advice(wrong)]))
    return {name: FoundService(name, **answer) for name, answer in answers.items()}


def _answers(done: subprocess.CompletedProcess[str]) -> dict[str, dict[str, Any]]:
    try:
        answers: dict[str, dict[str, Any]] = json.loads(done.stdout)
    except ValueError as error:
        said = done.stderr.strip().splitlines() or ["(nothing)"]
        raise EmbeddedError(f"The check of the given servers failed: {said[-1]}") from error
    return answers


def _advice(names: Mapping[str, str]) -> str:
    kinds = " and ".join(NAMES[name] for name in names)
    words = " ".join(names)
    return f"Start {kinds}, correct the address, or use the embedded one: unset {words}"
