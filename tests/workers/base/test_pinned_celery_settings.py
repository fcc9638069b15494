"""Every Celery setting on which "at most once" rests, for Redis and RabbitMQ: each has its test.

The table is written out here once more, so that a setting that is changed, added or left out
in `workers.base.celery_apps` fails under its own name.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import msgspec
import pytest
from celery import Celery

from tests.workers.base.test_celery_apps import KNOWN, RABBIT
from workers.base.celery_apps import (
    ACCEPT,
    AMQP_OPTIONS,
    EXECUTE,
    PINNED,
    REDIS_OPTIONS,
    WORKER_OPTIONS,
    make_accept_app,
    make_host_app,
)
from workers.base.config import ValkeyConfig, command_queue, line_queue
from workers.host.celery_tasks import add_accept, add_execute
from workers.host.valkey_process import valkey_arguments

ROOT = Path(__file__).parents[3]
LINE = "tcp:x:1"
HOST_ON_RABBIT = msgspec.structs.replace(
    KNOWN, valkey=ValkeyConfig(url="amqp://edge@127.0.0.1/host")
)

SETTINGS: dict[str, Any] = {
    # Bodies are JSON and nothing else: a pickle would be code from the broker.
    "task_serializer": "json",
    "result_serializer": "json",
    "accept_content": ["json"],
    # Facts come back as events alone.
    "result_backend": None,
    "task_ignore_result": True,
    "task_store_errors_even_if_ignored": False,
    "task_send_sent_event": False,
    "worker_send_task_events": False,
    # A worker consumes what it was told to, one message at a time.
    "task_create_missing_queues": False,
    "worker_prefetch_multiplier": 1,
    "worker_enable_prefetch_count_reduction": False,
    # Nothing ends an action from outside: no limit, no recycling, no lost connection, no revoke.
    "task_time_limit": None,
    "task_soft_time_limit": None,
    "worker_max_tasks_per_child": None,
    "worker_max_memory_per_child": None,
    "worker_cancel_long_running_tasks_on_connection_loss": False,
    "worker_enable_remote_control": False,
    # A broker that is away is waited for, for ever.
    "broker_connection_retry_on_startup": True,
    "broker_connection_max_retries": None,
    "broker_pool_limit": 2,
    "worker_hijack_root_logger": False,
    "worker_redirect_stdouts": False,
    "enable_utc": True,
}
REDIS = {
    "visibility_timeout": 45,
    "unacked_restore_interval": 5,
    "unacked_restore_throttle": 1,
    "socket_timeout": 30,
    "socket_connect_timeout": 5,
    "socket_keepalive": True,
}
AMQP = {"confirm_publish": True}

APPS: dict[str, tuple[Celery, dict[str, Any]]] = {
    "accept on Redis": (make_accept_app(KNOWN), REDIS),
    "accept on RabbitMQ": (make_accept_app(RABBIT), AMQP),
    "execute on Redis": (make_host_app(KNOWN, (LINE,)), REDIS),
    "execute on RabbitMQ": (make_host_app(HOST_ON_RABBIT, (LINE,)), AMQP),
}


@pytest.mark.parametrize("app", APPS)
@pytest.mark.parametrize("setting", SETTINGS)
def test_a_setting_has_its_value(app: str, setting: str) -> None:
    assert APPS[app][0].conf[setting] == SETTINGS[setting]


@pytest.mark.parametrize("app", APPS)
def test_options_of_the_broker_are_those_of_its_kind(app: str) -> None:
    made, options = APPS[app]
    assert made.conf.broker_transport_options == options
    assert made.conf.task_acks_late is False
    assert made.conf.task_reject_on_worker_lost in {None, False}


def test_nothing_is_pinned_that_the_table_does_not_name() -> None:
    assert PINNED == SETTINGS
    assert (REDIS_OPTIONS, AMQP_OPTIONS) == (REDIS, AMQP)
    assert WORKER_OPTIONS == (
        "--pool=solo",
        "--concurrency=1",
        "--without-gossip",
        "--without-mingle",
        "--without-heartbeat",
    )


@pytest.mark.parametrize("config", [KNOWN, RABBIT], ids=["Redis", "RabbitMQ"])
def test_accept_is_acknowledged_late_and_given_back(config: Any) -> None:  # noqa: ANN401
    app = make_accept_app(config)
    add_accept(app, lambda _: None)
    task = app.tasks[ACCEPT]
    assert (task.acks_late, task.reject_on_worker_lost, task.max_retries) == (True, True, 0)
    assert list(app.amqp.queues) == [command_queue(config.host_id)]
    assert app.amqp.queues[command_queue(config.host_id)].durable


@pytest.mark.parametrize("config", [KNOWN, HOST_ON_RABBIT], ids=["Redis", "RabbitMQ"])
def test_execute_is_acknowledged_early_and_never_cut_off(config: Any) -> None:  # noqa: ANN401
    app = make_host_app(config, (LINE,))
    add_execute(app, LINE, lambda: None)
    task = app.tasks[EXECUTE]
    assert (task.acks_late, task.max_retries) == (False, 0)
    assert (task.time_limit, task.soft_time_limit) == (None, None)
    assert not task.reject_on_worker_lost
    assert list(app.amqp.queues) == [line_queue(LINE)]


def test_a_queue_on_rabbitmq_keeps_what_it_gives_up() -> None:
    arguments = APPS["accept on RabbitMQ"][0].amqp.queues[command_queue(RABBIT.host_id)]
    assert arguments.queue_arguments == {
        "x-queue-type": "quorum",
        "x-delivery-limit": 20,
        "x-dead-letter-exchange": "edge.dead",
        "x-single-active-consumer": True,
    }


def test_the_host_s_own_broker_never_drops_a_wake_up_for_room() -> None:
    words = valkey_arguments(msgspec.structs.replace(KNOWN, valkey=ValkeyConfig(socket="/v")))
    assert words[words.index("--maxmemory-policy") + 1] == "noeviction"
    assert words[words.index("--unixsocketperm") + 1] == "700"
    assert words[words.index("--port") + 1] == "0"


SENDING = {"send_task", "apply_async", "task", "signature", "revoke"}


def calls_of_celery() -> list[tuple[str, str, set[str]]]:
    """List each call that sends, registers or takes back a task: place, name, keywords."""
    found = []
    for folder in ("workers", "labweb"):
        for path in (ROOT / folder).rglob("*.py"):
            text = path.read_text()
            if not any(f".{name}(" in text for name in SENDING):
                continue
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                    words = {one.arg or "**" for one in node.keywords}
                    found.append((f"{path.name}:{node.lineno}", node.func.attr, words))
    return [one for one in found if one[1] in SENDING]


def test_no_task_is_sent_for_later_or_with_a_limit_or_taken_back() -> None:
    """The schedule lives in the database; a message that waits in a worker is lost with it."""
    found = calls_of_celery()
    assert len(found) >= 4
    refused = {"eta", "countdown", "expires", "time_limit", "soft_time_limit"}
    assert [one for one in found if one[2] & refused or one[1] == "revoke"] == []
