"""The doorbell rings on a broker whose queue the host declared, and harms none that it did not."""

from __future__ import annotations

import os
from typing import Any
from uuid import uuid4

import pytest
from celery import Celery
from kombu.message import Message

from labweb.common import queue
from labweb.domain.messages.devices_and_drivers import Signed
from workers.base.celery_apps import make_accept_app
from workers.base.config import HostConfig, ValkeyConfig

SIGNED = Signed(body="{}", key_id="k", signature="s")


def brokers() -> list[str]:
    """Return the brokers of this session: always the embedded one, RabbitMQ when it is given."""
    return ["default"] + (["amqp"] if "AMQP_URL" in os.environ else [])


@pytest.mark.parametrize("broker", brokers())
def test_a_ring_reaches_the_queue_that_the_host_declared(
    broker: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = os.environ["AMQP_URL"] if broker == "amqp" else os.environ["REDIS_URL"]
    if url.startswith("unix://"):
        url = url.replace("unix://", "redis+socket://").replace("?db=", "?virtual_host=")
    monkeypatch.setattr(queue, "app", Celery("ringer", broker=url, set_as_current=False))
    host_id = uuid4()
    config = HostConfig(
        host_id=host_id,
        name="bench",
        server_url="ws://127.0.0.1:1",
        broker_url=url,
        data_dir="",
        key_file="",
        valkey=ValkeyConfig(url="redis://127.0.0.1:1"),
    )
    host = make_accept_app(config)
    with host.connection() as connection:
        (declared,) = host.amqp.queues.values()
        bound = declared(connection.default_channel)
        bound.declare()
        try:
            assert queue.ring(host_id, SIGNED)
            heard: list[tuple[str, Any]] = []

            def hear(body: Any, message: Message) -> None:  # noqa: ANN401 - any JSON
                heard.append((message.headers["task"], body[0][0]["body"]))
                message.ack()

            with connection.Consumer(bound, callbacks=[hear]):
                connection.drain_events(timeout=10)
            assert heard == [("edge.accept", "{}")]
        finally:
            bound.delete()


def test_a_broker_that_is_away_is_said_and_not_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    away = Celery("ringer", broker="redis://127.0.0.1:1/0", set_as_current=False)
    monkeypatch.setattr(queue, "app", away)
    assert not queue.ring(uuid4(), SIGNED)
