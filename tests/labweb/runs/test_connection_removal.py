"""A connection comes off the physical graph: who may, what speaks against it, what is left."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any

import msgspec
import pytest
from django.core.management import call_command
from django.db.models import Q
from pytest_django import Settings

from labweb.common.signatures import authority
from labweb.crutd import services as crutd_services
from labweb.crutd.models import Event, Holding
from labweb.crutd.selectors.history_replay import rebuild_differences
from labweb.domain.errors import PreconditionError
from labweb.enrollment.models import Device
from labweb.fleet.services.device_retirement import retire_device
from labweb.resources.models import Connection, Resource
from tests.builders import Bench, a_started_run, an_edge, off, to_transfer
from tests.labweb.crutd.hand import done, node, post, pour
from tests.labweb.crutd.test_adopting import adopted
from tests.labweb.enrollment.test_discovery import seen
from tests.labweb.web import read, signed_in


@pytest.fixture(autouse=True)
def _own_authority(settings: Settings, tmp_path: Path) -> Iterator[None]:
    settings.DATA_DIR = tmp_path
    yield
    authority._load.cache_clear()


def tube_of(bench: Bench, key: str) -> Connection:
    row = bench.node(key)
    return next(one for one in Connection.objects.all() if row.pk in {one.source_id, one.target_id})


def taking_off(tube: Connection, **fields: Any) -> dict[str, Any]:  # noqa: ANN401
    plain: dict[str, Any] = msgspec.to_builtins(off(tube))
    return {**plain, **fields}


def as_admin(bench: Bench, operation: dict[str, Any], at: str = "") -> tuple[int, dict[str, Any]]:
    status, told = post(bench, operation, role="admin", at=at)
    return status, told


def codes(bench: Bench, operation: dict[str, Any]) -> set[str]:
    """See it refused by check and act alike, with nothing changed; return the codes."""
    tubes, events = Connection.objects.count(), Event.objects.count()
    _, told = as_admin(bench, operation, "/check")
    found = {one["code"] for one in told["findings"]}
    assert as_admin(bench, operation)[0] in {412, 423}
    assert (Connection.objects.count(), Event.objects.count()) == (tubes, events)
    return found


def test_an_admin_takes_a_tube_off_and_the_events_tell_the_graph_as_it_is(bench: Bench) -> None:
    tube = tube_of(bench, "flask_1")
    status, told = as_admin(bench, taking_off(tube))
    assert (status, told["operation"], told["state"]) == (201, "delete", "committed")
    assert told["summary"] == "Valve 1 and Flask 1 taken apart"
    assert not Connection.objects.filter(pk=tube.pk).exists()
    assert rebuild_differences(bench.lab) == []
    call_command("rebuild", "--check", stdout=StringIO())


def test_a_rebuild_puts_no_tube_back_that_was_taken_off_and_takes_off_what_no_event_tells(
    bench: Bench,
) -> None:
    tube, other = tube_of(bench, "flask_1"), tube_of(bench, "flask_2")
    assert as_admin(bench, taking_off(tube))[0] == 201
    left = list(Connection.objects.order_by("id").values())
    Connection.objects.filter(pk=other.pk).update(target_port="99")
    tube.save(force_insert=True)
    assert {one.code for one in rebuild_differences(bench.lab)} == {"rebuild.graph"}
    crutd_services.rebuild(bench.lab)
    assert list(Connection.objects.order_by("id").values()) == left
    assert rebuild_differences(bench.lab) == []


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_who_may_not_admit_devices_takes_nothing_off(bench: Bench, role: str) -> None:
    tube = tube_of(bench, "flask_1")
    for at in ("", "/check"):
        assert post(bench, taking_off(tube), role=role, at=at)[0] == 403
    client = signed_in(bench.people[role])
    ports = read(client, f"/api/v1/resources/{node(bench, 'flask_1')}")["ports"]
    assert [port["may_disconnect"] for port in ports] == [False] * len(ports)
    assert Connection.objects.filter(pk=tube.pk).exists()


def test_the_page_of_a_resource_tells_what_takes_each_of_its_connections_off(bench: Bench) -> None:
    client = signed_in(bench.people["admin"])
    flask = f"/api/v1/resources/{node(bench, 'flask_1')}"
    for port in read(client, flask)["ports"]:
        assert port["may_disconnect"] is True
        wanted = {"op": "disconnect", **port["connection"], "is_seen_empty": True}
        assert as_admin(bench, wanted)[0] == 201
    assert read(client, flask)["ports"] == []


@pytest.mark.parametrize(
    "stale", [{"target_port": "7"}, {"key": "another"}, {"medium": "gas"}, {"source_port": "x"}]
)
def test_a_connection_that_has_changed_since_it_was_shown_stays(
    bench: Bench, stale: dict[str, Any]
) -> None:
    tube = tube_of(bench, "flask_1")
    assert codes(bench, taking_off(tube, **stale)) == {"crutd.no_connection"}


def test_a_connection_is_taken_off_once(bench: Bench) -> None:
    wanted = taking_off(tube_of(bench, "flask_1"))
    assert as_admin(bench, wanted)[0] == 201
    assert codes(bench, wanted) == {"crutd.no_connection"}


def test_a_tube_that_nobody_has_seen_empty_stays(bench: Bench) -> None:
    wanted = taking_off(tube_of(bench, "flask_1"), is_seen_empty=False)
    assert codes(bench, wanted) == {"crutd.not_seen_empty"}


def test_liquid_in_a_syringe_keeps_the_tube_that_leads_out_of_it(bench: Bench) -> None:
    syringe = next(
        one for one in Resource.objects.filter(kind="syringe_pump") if tubes_at(one.key, bench)
    )
    done(bench, pour(bench, "flask_1", syringe.key, 1000) | {"source_id": full(bench)})
    found = codes(bench, taking_off(tubes_at(syringe.key, bench)[0]))
    assert "crutd.holds_matter" in found


def tubes_at(key: str, bench: Bench) -> list[Connection]:
    row = bench.node(key)
    return list(Connection.objects.filter(Q(source=row) | Q(target=row), medium="liquid"))


def full(bench: Bench) -> str:
    """Return a vessel that holds enough."""
    found = Holding.objects.filter(resource__lab=bench.lab, amount_nl__gt=1_000_000).first()
    assert found is not None
    return str(found.resource_id)


def test_a_job_under_way_keeps_its_tubes(bench: Bench) -> None:
    attempt = to_transfer(a_started_run(bench), an_edge(bench))
    ends = set(attempt.job.locks)
    tube = next(
        one
        for one in Connection.objects.all()
        if {str(one.source_id), str(one.target_id)} <= ends and one.medium == "liquid"
    )
    assert {"device.has_job", "crutd.held_elsewhere"} <= codes(bench, taking_off(tube))


def test_a_run_that_waits_keeps_the_tubes_that_it_goes_through(bench: Bench) -> None:
    job = a_started_run(bench).jobs.order_by("index").last()
    assert job is not None
    assert job.state in {"draft", "queued", "held"}
    tube = next(
        one
        for one in Connection.objects.all()
        if any(
            {str(one.source_id), str(one.target_id)} <= set(other.locks)
            for other in job.run.jobs.all()
        )
    )
    assert "device.has_job" in codes(bench, taking_off(tube))


def test_a_device_that_is_plumbed_is_retired_once_its_tubes_are_off(bench: Bench) -> None:
    device = adopted(bench, seen(bench, an_edge(bench)))
    valve = bench.node("pump_9_valve")
    Connection.objects.filter(target=bench.node("flask_1")).delete()
    inner = Connection.objects.get(target=valve)
    assert codes(bench, taking_off(inner)) == {"crutd.own_connection"}
    outer = Connection.objects.create(
        lab=bench.lab, key="outer", source=valve, source_port="1",
        target=bench.node("flask_2"), target_port="", medium="liquid",
    )  # fmt: skip
    retired = partial(retire_device, device.id, actor=bench.people["admin"], reason="broken")
    with pytest.raises(PreconditionError) as caught:
        retired()
    assert [one.code for one in caught.value.findings] == ["crutd.connected"]
    assert as_admin(bench, taking_off(outer))[0] == 201
    assert retired().state == Device.State.RETIRED
