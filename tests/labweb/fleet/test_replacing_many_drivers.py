"""A version is given to several devices at once: to all of them, or to none."""

from __future__ import annotations

import json
from uuid import UUID, uuid4

import pytest

from labweb.accounts.models import AuditEntry
from labweb.domain.errors import (
    DefinitionError,
    ForbiddenError,
    NotFoundError,
    PreconditionError,
)
from labweb.enrollment import services as enrollment_services
from labweb.fleet.services import driver_replacement
from labweb.fleet.services.driver_replacement import GivenDriver
from tests.builders import Bench, an_edge
from tests.labweb.enrollment.driver_texts import approved, timer
from tests.labweb.fleet.test_driver_replacement import a_pump, ready, want
from tests.labweb.web import call, read, signed_in

PUMPS = ("pump_1", "pump_2")


def ids(bench: Bench, *keys: str) -> list[UUID]:
    return [bench.device(key).id for key in keys]


def give(bench: Bench, version_id: UUID, device_ids: list[UUID], role: str = "admin") -> None:
    driver_replacement.replace_drivers(
        version_id,
        [GivenDriver(one) for one in device_ids],
        actor=bench.people[role],
        reason="better",
    )


def test_all_of_them_are_staged_at_once_and_each_changes_when_its_host_has_built_it(
    bench: Bench,
) -> None:
    edge, version = an_edge(bench), a_pump(bench)
    give(bench, version.id, ids(bench, *PUMPS))
    told = enrollment_services.devices_of(edge.host_id, edge.epoch)
    assert told is not None
    assert {one.key for one in told.staged} == set(PUMPS)
    for key in PUMPS:
        ready(edge, bench.device(key), version)
    assert {bench.device(key).driver for key in PUMPS} == {version}
    assert AuditEntry.objects.filter(action="driver.want").count() == 2


def test_where_one_is_refused_none_gets_it_and_every_finding_names_its_device(
    bench: Bench,
) -> None:
    version = a_pump(bench)
    want(bench, "pump_2", version)
    before = AuditEntry.objects.count()
    with pytest.raises(PreconditionError) as refusal:
        give(bench, version.id, ids(bench, *PUMPS, "timer_1"))
    findings = refusal.value.findings
    assert {one.subject for one in findings} == {
        bench.device("pump_2").name,
        bench.device("timer_1").name,
    }
    assert "driver.known" in {one.code for one in findings}
    assert all(one.message.startswith(one.subject) for one in findings)
    assert bench.device("pump_1").next_driver is None
    assert AuditEntry.objects.count() == before


def test_who_may_not_admit_one_of_them_gives_it_to_none(bench: Bench) -> None:
    version = a_pump(bench)
    with pytest.raises(ForbiddenError):
        give(bench, version.id, ids(bench, *PUMPS), role="chemist")
    assert {bench.device(key).next_driver for key in PUMPS} == {None}


def test_a_device_that_is_named_twice_or_is_none_is_refused(bench: Bench) -> None:
    version = a_pump(bench)
    (pump,) = ids(bench, "pump_1")
    with pytest.raises(DefinitionError) as refusal:
        give(bench, version.id, [pump, pump])
    assert refusal.value.code == "driver.named_twice"
    with pytest.raises(NotFoundError):
        give(bench, version.id, [pump, uuid4()])
    with pytest.raises(NotFoundError, match="no driver version"):
        give(bench, uuid4(), [pump])
    assert bench.device("pump_1").next_driver is None


def test_it_is_asked_for_over_the_api(bench: Bench) -> None:
    an_edge(bench)
    version, client = a_pump(bench), signed_in(bench.people["admin"])
    path = f"/api/v1/drivers/{version.id}/devices"
    devices = [{"device_id": str(one)} for one in ids(bench, *PUMPS)]
    answer = call(client, "POST", path, {"devices": devices, "reason": "better"})
    assert answer.status_code == 200
    given = json.loads(answer.content)["devices"]
    assert {one["driver"]["next"]["version_id"] for one in given} == {str(version.id)}
    assert {one["id"] for one in given} == {one["device_id"] for one in devices}
    places = read(client, f"/api/v1/drivers/{version.id}")["places"]
    assert all(one["driver"]["next"] for one in places if one["key"] in PUMPS)
    for body in (
        {"devices": [], "reason": "better"},
        {"devices": devices * 101, "reason": "better"},
        {"devices": devices, "reason": "better", "by": "me"},
        {"devices": [{"device_id": "pump"}], "reason": "better"},
    ):
        assert call(client, "POST", path, body).status_code in {400, 422}
    other = approved(bench, timer())
    path = f"/api/v1/drivers/{other.id}/devices"
    answer = call(client, "POST", path, {"devices": devices, "reason": "better"})
    assert answer.status_code == 412
    names = {one["subject"] for one in json.loads(answer.content)["findings"]}
    assert names == {bench.device(key).name for key in PUMPS}
