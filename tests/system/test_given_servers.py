"""A lab on servers that were given to it uses those, and starts none of its own but the host's."""

from __future__ import annotations

import json
from typing import Any
from urllib.parse import unquote, urlsplit

import psycopg
import pytest
from kombu import Connection
from redis import Redis

from tests.services import given_urls
from tests.system.stack import Stack, is_over

pytestmark = [
    pytest.mark.slow,
    pytest.mark.services,
    pytest.mark.timeout(240),
    pytest.mark.skipif(not given_urls(), reason="no servers were given: see make test-services"),
]


def test_a_run_goes_through_the_given_servers_alone(stack: Stack) -> None:
    run = stack.client().start("Move 5 mL of water")
    seen = stack.client().wait_for_run(run["id"], is_over)
    assert seen["state"] == "complete"
    lines = stack.command_lines()
    assert not any("/bin/postgres -D" in line for line in lines)
    assert not any("/vk.sock" in line for line in lines)
    assert any("valkey-server" in line and "/host.sock" in line for line in lines)


@pytest.mark.skipif("DATABASE_URL" not in given_urls(), reason="no DATABASE_URL was given")
def test_the_record_is_in_the_given_database(stack: Stack) -> None:
    found = stack.client().get("runs")["runs"]
    with psycopg.connect(stack.given["DATABASE_URL"]) as connection:
        count = connection.execute("SELECT count(*) FROM runs_run").fetchone()
    assert count is not None
    assert count[0] >= len(found) > 0


@pytest.mark.skipif("REDIS_URL" not in given_urls(), reason="no REDIS_URL was given")
def test_the_feed_is_in_the_given_redis_under_the_lab_s_own_number(stack: Stack) -> None:
    number = urlsplit(stack.given["REDIS_URL"]).path.removeprefix("/")
    with Redis.from_url(stack.given["REDIS_URL"]) as client:
        channels = client.pubsub_channels(f"labweb.{number}*")
    assert channels


@pytest.mark.skipif("AMQP_URL" not in given_urls(), reason="no AMQP_URL was given")
def test_the_host_listens_on_a_queue_of_the_lab_s_own_virtual_host(stack: Stack) -> None:
    config = json.loads((stack.data / "host" / "host.json").read_text())
    assert config["broker_url"] == stack.given["AMQP_URL"]
    vhost = unquote(urlsplit(stack.given["AMQP_URL"]).path.removeprefix("/"))
    assert vhost.startswith("labweb-test-")
    queue = f"edge.{config['host_id']}.cmd"
    with Connection(stack.given["AMQP_URL"], connect_timeout=5) as connection:
        opened: Any = connection.default_channel
        told = opened.queue_declare(queue, passive=True)
        assert told.consumer_count >= 1
        assert told.message_count == 0
    with Connection(given_urls()["AMQP_URL"], connect_timeout=5) as connection:
        channel: Any = connection.default_channel
        with pytest.raises(connection.channel_errors, match="NOT_FOUND"):
            channel.queue_declare(queue, passive=True)
