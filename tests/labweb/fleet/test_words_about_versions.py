"""Words of hosts about versions of drivers that make no sense, and versions that stay out."""

from __future__ import annotations

from typing import Any
from uuid import UUID

import pytest

from labweb.crutd.models import Ticket
from labweb.enrollment.models import Device, DriverVersion
from labweb.fleet.services import driver_replacement
from tests.builders import Bench, a_started_run, an_edge
from tests.labweb.enrollment.driver_texts import approved, timer
from tests.labweb.fleet.test_driver_replacement import ready, want

WORDS: dict[str, dict[str, Any]] = {
    "no device": {"digest": "0" * 64},
    "no digest": {"device_id": str(UUID(int=1))},
    "no id": {"device_id": "pump", "digest": "0" * 64},
    "no list": {"device_id": [1], "digest": None},
}


@pytest.mark.parametrize("word", WORDS)
@pytest.mark.parametrize("kind", ["driver_ready", "driver_refused", "driver_serving"])
def test_a_word_about_a_version_that_makes_no_sense_is_a_ticket_and_its_host_goes_on(
    bench: Bench, kind: str, word: str
) -> None:
    run, edge = a_started_run(bench), an_edge(bench)
    body = WORDS[word]
    assert [edge.report(kind, None, **body) for _ in range(2)] == [1, 2]
    ticket = Ticket.objects.get()
    assert (ticket.code, ticket.detail["kind"], ticket.detail["seq"]) == ("host.bad_word", kind, 1)
    assert kind in ticket.message
    edge.work_off(run)
    run.refresh_from_db()
    assert (run.state, bench.host.state) == ("complete", "online")


def test_a_refusal_with_a_null_character_is_kept_and_shown(bench: Bench) -> None:
    edge, version = an_edge(bench), approved(bench, timer())
    device = want(bench, "timer_1", version)
    said = {"device_id": str(device.id), "digest": version.digest, "message": "got 'A\0B'"}
    assert edge.report("driver_refused", None, **said) == 1
    assert bench.device("timer_1").driver_problem["message"] == "got 'A␀B'"
    assert bench.host.state == "online"


def test_a_device_whose_own_driver_its_host_cannot_load_says_so_and_what_to_do(
    bench: Bench,
) -> None:
    edge, device = an_edge(bench), bench.device("timer_1")
    said = {"device_id": str(device.id), "digest": device.driver.digest}
    problem = {"code": "driver.digest", "message": "drivers.virtual.timer is not what was approved"}
    for _ in range(2):
        edge.report("driver_refused", None, **said, **problem)
    ticket = Ticket.objects.get()
    assert ticket.code == "driver.not_served"
    assert f"{device.name} is not served" in ticket.message
    assert "is not what was approved. Put the approved source back" in ticket.message
    assert bench.device("timer_1").driver_problem["code"] == "driver.digest"
    edge.report("driver_serving", None, **said)
    assert bench.device("timer_1").driver_problem == {}


def test_a_version_that_cannot_be_switched_is_given_up_for_a_suspended_device_too(
    bench: Bench,
) -> None:
    edge, version = an_edge(bench), approved(bench, timer())
    device = want(bench, "timer_1", version)
    broken = {"state": "suspended", "is_next_ready": True, "next_parts": {"digest": ""}}
    Device.objects.filter(pk=device.pk).update(**broken)
    DriverVersion.objects.filter(pk=version.pk).update(spec={"class_name": "HostTimer"})
    driver_replacement.switch_waiting()
    assert bench.device("timer_1").next_driver is None, "it would be tried each second for ever"
    assert Ticket.objects.get().code == "driver.refused"
    assert edge.epoch


def test_a_version_that_cannot_be_switched_is_given_up_and_holds_up_no_host(bench: Bench) -> None:
    """What was decided of its parts is lost: the version before stays, and a person looks."""
    edge, version = an_edge(bench), approved(bench, timer())
    device = want(bench, "timer_1", version)
    Device.objects.filter(pk=device.pk).update(next_parts={"digest": ""})
    before = device.driver
    DriverVersion.objects.filter(pk=version.pk).update(spec={"class_name": "HostTimer"})
    ready(edge, device, version)
    device = bench.device("timer_1")
    assert (device.driver, device.next_driver) == (before, None)
    assert device.driver_problem["code"] == "driver.not_switched"
    assert Ticket.objects.get(code="driver.refused").detail["digest"] == version.digest
    assert bench.host.state == "online"
