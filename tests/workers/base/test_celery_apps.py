"""The settings on which it depends that no device acts twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from labweb.domain.errors import DefinitionError
from tests.workers.bench import HOST_ID
from workers.base.celery_apps import ACCEPT, EXECUTE, WORKER_OPTIONS, make_accept_app, make_host_app
from workers.base.config import HostConfig, ValkeyConfig, command_queue, line_queue, load_config
from workers.host.celery_tasks import add_accept, add_execute

KNOWN = HostConfig(
    host_id=HOST_ID,
    name="bench",
    server_url="ws://127.0.0.1:8400",
    broker_url="redis://127.0.0.1:6379/1",
    data_dir="/nowhere",
    key_file="/nowhere/key",
    valkey=ValkeyConfig(socket="/nowhere/vk"),
)
RABBIT = msgspec.structs.replace(KNOWN, broker_url="amqp://edge@127.0.0.1/lab")


@pytest.mark.parametrize("app", [make_accept_app(KNOWN), make_host_app(KNOWN, ("tcp:x:1",))])
@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("task_serializer", "json"),
        ("accept_content", ["json"]),
        ("task_ignore_result", True),
        ("task_acks_late", False),
        ("task_time_limit", None),
        ("task_soft_time_limit", None),
        ("task_create_missing_queues", False),
        ("worker_prefetch_multiplier", 1),
        ("worker_cancel_long_running_tasks_on_connection_loss", False),
        ("worker_enable_prefetch_count_reduction", False),
        ("worker_enable_remote_control", False),
        ("worker_max_tasks_per_child", None),
        ("worker_max_memory_per_child", None),
        ("worker_send_task_events", False),
        ("broker_connection_max_retries", None),
        ("broker_connection_retry_on_startup", True),
    ],
)
def test_a_setting_is_pinned(app: Any, name: str, wanted: object) -> None:  # noqa: ANN401 - Celery
    assert app.conf[name] == wanted
    assert app.conf.result_backend is None


def test_accept_acknowledges_late_and_survives_the_loss_of_its_worker() -> None:
    app = make_accept_app(KNOWN)
    add_accept(app, lambda _: None)
    task = app.tasks[ACCEPT]
    assert (task.acks_late, task.reject_on_worker_lost, task.ignore_result) == (True, True, True)


def test_execute_acknowledges_early_and_has_no_time_limit() -> None:
    app = make_host_app(KNOWN, ("tcp:x:1",))
    add_execute(app, "tcp:x:1", lambda: None)
    task = app.tasks[EXECUTE]
    assert (task.acks_late, task.time_limit, task.soft_time_limit) == (False, None, None)
    assert task.ignore_result


def test_each_app_consumes_its_own_queue_and_no_other() -> None:
    accept, execute = make_accept_app(KNOWN), make_host_app(KNOWN, ("tcp:x:1",))
    assert list(accept.amqp.queues) == [command_queue(HOST_ID)]
    assert list(execute.amqp.queues) == [line_queue("tcp:x:1")]


def test_a_worker_neither_gossips_nor_mingles_and_runs_one_thing_at_a_time() -> None:
    wanted = {"--without-gossip", "--without-mingle", "--without-heartbeat", "--concurrency=1"}
    assert wanted <= set(WORKER_OPTIONS)


def test_redis_gives_back_a_lost_command_and_rabbitmq_confirms_each() -> None:
    redis = make_accept_app(KNOWN).conf.broker_transport_options
    assert redis["visibility_timeout"] == 45
    assert redis["unacked_restore_throttle"] == 1
    rabbit = make_accept_app(RABBIT)
    assert rabbit.conf.broker_transport_options == {"confirm_publish": True}
    arguments = rabbit.amqp.queues[command_queue(HOST_ID)].queue_arguments
    assert arguments is not None
    assert arguments["x-queue-type"] == "quorum"
    assert arguments["x-single-active-consumer"]
    assert arguments["x-delivery-limit"] > 0
    assert arguments["x-dead-letter-exchange"]


def test_a_message_that_is_no_signed_command_is_put_aside() -> None:
    taken: list[object] = []
    app = make_accept_app(KNOWN)
    add_accept(app, taken.append)
    app.tasks[ACCEPT]({"body": 1})
    app.tasks[ACCEPT]({"body": "{}", "key_id": "k", "signature": "s"})
    assert len(taken) == 1


@pytest.mark.parametrize(
    "change",
    [
        {"valkey": {}},
        {"valkey": {"socket": "/s", "url": "redis://x"}},
        {"valkey": {"socket": "/" + "s" * 120}},
        {"server_url": "http://x"},
        {"stop_grace_s": -1},
        {"mode": "real"},
        {"colour": "red"},
    ],
)
def test_a_configuration_that_contradicts_itself_is_refused(
    tmp_path: Path, change: dict[str, object]
) -> None:
    path = tmp_path / "host.json"
    path.write_bytes(msgspec.json.encode(KNOWN))
    assert load_config(path) == KNOWN
    path.write_bytes(msgspec.json.encode({**msgspec.to_builtins(KNOWN), **change}))
    with pytest.raises(DefinitionError):
        load_config(path)
