"""Below the floor no run is started, one that waits does not begin, and one that has goes on."""

from __future__ import annotations

import errno

import pytest
from django.db import OperationalError
from django.test import Client
from redis.exceptions import ResponseError

from labweb.api.errors import is_short_of_room
from labweb.common import disk
from labweb.domain.disk_space import DiskSpace
from labweb.domain.errors import PreconditionError
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.models import EdgeHost
from labweb.runs import services
from tests.builders import Bench, a_started_run, an_edge, dispatched
from tests.labweb.web import signed_in

GB = 10**9


def set_server(patch: pytest.MonkeyPatch, free_gb: float) -> None:
    found = DiskSpace(name=disk.SERVER, free_bytes=round(free_gb * GB), total_bytes=100 * GB)
    patch.setattr(disk, "server_disk", lambda: found)


def set_host(free_gb: float) -> EdgeHost:
    host = EdgeHost.objects.get()
    free = round(free_gb * GB)
    beat = {"disk_free_bytes": free, "disk_total_bytes": 100 * GB, "epoch": host.epoch}
    assert enrollment_services.beat(host.pk, host.epoch, {**host.heartbeat, **beat})
    return host


def test_no_run_is_started_while_the_servers_disk_is_full(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    set_server(monkeypatch, 0.1)
    with pytest.raises(PreconditionError, match="disk of the server has") as refusal:
        a_started_run(bench)
    assert refusal.value.code == "run.disk_full"
    set_server(monkeypatch, 1.5)
    a_started_run(bench)


def test_no_run_is_started_while_a_disk_of_its_hosts_is_full(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    set_server(monkeypatch, 50)
    an_edge(bench)
    host = set_host(0.1)
    with pytest.raises(PreconditionError, match=f"disk of {host.name} has 0.1 GB left"):
        a_started_run(bench)
    set_host(0.6)
    a_started_run(bench)


@pytest.mark.parametrize("whose", ["server", "host"])
def test_a_run_that_waits_begins_with_room_and_one_that_has_begun_goes_on(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, whose: str
) -> None:
    def leave(free_gb: float) -> None:
        if whose == "server":
            set_server(monkeypatch, free_gb)
        else:
            set_host(free_gb)

    set_server(monkeypatch, 50)
    run, edge = a_started_run(bench), an_edge(bench)
    leave(0.1)
    assert services.dispatch_ready() == 0
    leave(0.6)
    attempt = dispatched(run)
    leave(0.1)
    edge.complete(attempt)
    assert services.dispatch_ready() == 1, "a run is left half done"


def test_home_and_health_warn_of_a_disk_before_anything_fails(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    chemist = signed_in(bench.people["chemist"])
    an_edge(bench)
    set_server(monkeypatch, 50)
    host = set_host(50)
    before = chemist.get("/api/v1/session").json()["lab"]["counts"]["needs_you"]
    set_host(0.6)
    (need,) = [one for one in _needs(chemist) if one["kind"] == "disk"]
    assert need["title"] == f"The disk of {host.name} has 0.6 GB left"
    assert need["detail"].startswith("Runs are not started below 0.2 GB. Free some space on it")
    assert need["url"] == f"/hosts/{host.pk}"
    assert chemist.get("/api/v1/session").json()["lab"]["counts"]["needs_you"] == before + 1
    told = chemist.get(f"/api/v1/hosts/{host.pk}").json()["disk"]
    assert (told["level"], told["free_bytes"]) == ("low", 600_000_000)
    assert told["text"] == f"{need['title']}. {need['detail']}"
    assert Client().get("/healthz").json() == {"ok": True, "disk": "ok"}
    set_server(monkeypatch, 0.1)
    assert Client().get("/healthz").json() == {"ok": True, "disk": "full"}
    assert next(one["kind"] for one in _needs(chemist)) == "disk"


def _needs(client: Client) -> list[dict[str, str]]:
    found: list[dict[str, str]] = client.get("/api/v1/home").json()["needs_you"]
    return found


def test_a_failure_is_told_as_a_full_disk_only_where_it_comes_of_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    set_server(monkeypatch, 50)
    assert is_short_of_room(OSError(errno.ENOSPC, "No space left on device"))
    assert is_short_of_room(OSError(errno.EROFS, "Read-only file system"))
    assert is_short_of_room(ResponseError("MISCONF Errors writing to the AOF file"))
    assert not is_short_of_room(ResponseError("WRONGTYPE"))
    assert not is_short_of_room(OSError(errno.EMFILE, "Too many open files"))
    assert not is_short_of_room(OperationalError("connection refused"))
    set_server(monkeypatch, 0.0)
    assert is_short_of_room(OperationalError("connection refused"))
