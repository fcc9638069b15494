"""A file is taken in by a request and read by the server's own worker; what is lost is found."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any
from uuid import UUID, uuid4

import pytest
from celery.contrib.testing.worker import start_worker
from django.core.files.uploadedfile import SimpleUploadedFile
from django.db import connections
from django.db.transaction import atomic
from django.test import Client
from kombu import Connection
from pytest_django import Settings

from labweb.celery import app
from labweb.common import queue
from labweb.common.clock import now
from labweb.runs import tasks
from labweb.telemetry import services
from labweb.telemetry.models import File, Incoming
from labweb.telemetry.services import incoming_files
from tests.builders import Bench, a_lab, a_user
from tests.labweb.instrument_files import TRACE
from tests.labweb.web import read, signed_in

API = "/api/v1"
pytestmark = pytest.mark.django_db(transaction=True)


@pytest.fixture
def bench(transactional_db: None) -> Bench:
    return a_lab()


@pytest.fixture(autouse=True)
def store(settings: Settings, tmp_path: Path) -> Path:
    settings.DATA_DIR = tmp_path
    return tmp_path / "files"


@pytest.fixture(autouse=True)
def own_queue(monkeypatch: pytest.MonkeyPatch) -> str:
    """Several runs of the tests share one broker."""
    name = f"server-{uuid4().hex}"
    monkeypatch.setattr(queue, "SERVER_QUEUE", name)
    return name


@pytest.fixture
def worker(own_queue: str) -> Iterator[None]:
    """The worker of `celery -A labweb worker -Q server`, in a thread, on the real broker."""
    assert tasks.read_file.name in app.tasks
    with start_worker(app, pool="solo", queues=[own_queue], perform_ping_check=False):
        yield


def post(client: Client, raw: str, status: int = 202, **form: Any) -> dict[str, Any]:  # noqa: ANN401
    file = SimpleUploadedFile("trace.csv", raw.encode())
    answer = client.post(f"{API}/files", {"format": "csv", "file": file} | form)
    assert answer.status_code == status, answer.content
    told: dict[str, Any] = json.loads(answer.content)
    return told


def bytes_left(store: Path) -> list[Path]:
    return [path for path in store.rglob("*") if path.is_file()]


def asked(name: str) -> int:
    """Return how many messages wait for the worker."""
    with Connection(app.conf.broker_url) as connection:
        return connection.SimpleQueue(name).qsize()


def ended(client: Client, told: dict[str, Any]) -> dict[str, Any]:
    for _ in range(1000):
        row = read(client, f"{API}/files/incoming/{told['id']}")
        if row["state"] != "pending":
            return row
        threading.Event().wait(0.05)
    raise AssertionError("nobody read the file")


def test_the_worker_reads_what_a_request_took_in(bench: Bench, worker: None, store: Path) -> None:
    chemist = signed_in(bench.people["chemist"])
    told = post(chemist, TRACE, resource=bench.node("flask_1").pk)
    assert (told["state"], told["name"], told["size_bytes"]) == ("pending", "trace.csv", len(TRACE))
    row = ended(chemist, told)
    assert row["state"] == "parsed"
    file = read(chemist, f"{API}/files/{row['file_id']}")
    assert (file["sha256"], file["kept_by"]) == (told["sha256"], "Chemist Person")
    assert [reading["name"] for reading in file["readings"]] == ["absorbance", "temperature"]
    assert read(chemist, f"{API}/files/incoming")["incoming"] == []
    for _ in range(100):
        if len(bytes_left(store)) == 2:
            break
        threading.Event().wait(0.05)
    assert {path.name for path in bytes_left(store)} == {
        file["sha256"],
        file["series"][0]["sha256"],
    }


def test_a_request_reads_nothing_and_a_refusal_says_why(
    bench: Bench, own_queue: str, store: Path
) -> None:
    chemist = signed_in(bench.people["chemist"])
    told = post(chemist, TRACE.replace("0.15", "much"), resource=bench.node("flask_1").pk)
    assert asked(own_queue) == 1
    assert not File.objects.exists()
    tasks.read_file(told["id"])
    row = read(chemist, f"{API}/files/incoming/{told['id']}")
    assert (row["state"], row["code"], row["file_id"]) == ("refused", "instrument.invalid", None)
    assert [finding["subject"] for finding in row["findings"]] == ["line 4, absorbance"]
    assert [one["id"] for one in read(chemist, f"{API}/files/incoming")["incoming"]] == [told["id"]]
    assert not File.objects.exists()
    assert bytes_left(store) == []


def test_a_message_that_was_lost_is_sent_again(bench: Bench, own_queue: str) -> None:
    chemist = signed_in(bench.people["chemist"])
    told = post(chemist, TRACE, resource=bench.node("flask_1").pk)
    with Connection(app.conf.broker_url) as connection:
        connection.SimpleQueue(own_queue).get(timeout=5).ack()
    assert services.ring_incoming() == 0
    Incoming.objects.update(asked_at=now() - incoming_files.RING_AGAIN_AFTER - timedelta(seconds=1))
    assert services.ring_incoming() == 1
    assert asked(own_queue) == 1
    assert services.ring_incoming() == 0
    services.read_incoming(UUID(told["id"]))
    services.read_incoming(UUID(told["id"]))
    assert File.objects.filter(made_from=None).count() == 1
    Incoming.objects.update(asked_at=now() - timedelta(hours=1))
    assert services.ring_incoming() == 0


def test_a_file_that_is_being_read_is_neither_asked_for_nor_read_again(bench: Bench) -> None:
    told = post(signed_in(bench.people["chemist"]), TRACE, resource=bench.node("flask_1").pk)
    Incoming.objects.update(asked_at=now() - timedelta(hours=1))
    counts: list[int] = []

    def meanwhile() -> None:
        try:
            counts.append(services.ring_incoming())
            services.read_incoming(UUID(told["id"]))
        finally:
            connections.close_all()

    with atomic():
        Incoming.objects.select_for_update().get()
        other = threading.Thread(target=meanwhile)
        other.start()
        other.join()
    assert counts == [0]
    row = Incoming.objects.get()
    assert (row.state, row.tries) == ("pending", 0)


def test_a_file_at_which_the_worker_ended_again_and_again_is_refused(bench: Bench) -> None:
    told = post(signed_in(bench.people["chemist"]), TRACE, resource=bench.node("flask_1").pk)
    Incoming.objects.update(tries=incoming_files.MOST_TRIES)
    services.read_incoming(UUID(told["id"]))
    row = Incoming.objects.get()
    assert (row.state, row.code) == ("refused", "instrument.unreadable")


@pytest.mark.parametrize("harm", ["gone", "changed"])
def test_bytes_that_are_not_those_that_were_brought_are_not_read(
    bench: Bench, store: Path, harm: str
) -> None:
    told = post(signed_in(bench.people["chemist"]), TRACE, resource=bench.node("flask_1").pk)
    (path,) = bytes_left(store)
    if harm == "gone":
        path.unlink()
    else:
        path.write_bytes(TRACE.replace("0.15", "0.51").encode())
    services.read_incoming(UUID(told["id"]))
    row = Incoming.objects.get()
    assert (row.state, row.code) == ("refused", "file.damaged")
    assert not File.objects.exists()


def test_the_same_bytes_are_not_taken_in_twice(bench: Bench, store: Path) -> None:
    chemist, flask = signed_in(bench.people["chemist"]), bench.node("flask_1").pk
    told = post(chemist, TRACE, resource=flask)
    again = post(chemist, TRACE, status=409, resource=flask)
    assert (again["code"], again["context"]["incoming_id"]) == ("file.being_read", told["id"])
    services.read_incoming(UUID(told["id"]))
    assert post(chemist, TRACE, status=409, resource=flask)["code"] == "file.exists"
    assert not [path for path in bytes_left(store) if ".waiting" in path.parts]


def test_a_broker_that_is_away_delays_the_reading_and_loses_nothing(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(app.amqp, "_producer_pool", None)
    monkeypatch.setattr(app, "_pool", None)
    monkeypatch.setattr(app.conf, "broker_url", "redis://127.0.0.1:1/0")
    monkeypatch.setattr(app.conf, "broker_write_url", "redis://127.0.0.1:1/0")
    assert queue.ask(services.READ_TASK, str(uuid4())) is False


def test_what_is_outside_the_subtree_is_as_if_not_there(bench: Bench) -> None:
    chemist = signed_in(bench.people["chemist"])
    told = post(chemist, TRACE, resource=bench.node("water").pk)
    guest = signed_in(a_user("chemist", on=bench.node("balance_1"), name="guest"))
    path = f"{API}/files/incoming"
    assert read(guest, f"{path}/{told['id']}", status=404)["code"] == "file.not_found"
    assert read(guest, path)["incoming"] == []
