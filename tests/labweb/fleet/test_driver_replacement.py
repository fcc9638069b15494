"""A device gets another version of its driver while runs go on."""

from __future__ import annotations

import json
import threading
from typing import Any
from uuid import UUID

import pytest
from django.db import OperationalError, connection
from django.db.transaction import atomic
from django.test.utils import CaptureQueriesContext

from labweb.accounts import services as account_services
from labweb.approvals import services as approval_services
from labweb.crutd.models import Ticket
from labweb.domain.errors import DefinitionError, ForbiddenError, PreconditionError, StateError
from labweb.enrollment import services as enrollment_services
from labweb.enrollment.models import Device, DriverVersion
from labweb.fleet.services import driver_replacement
from labweb.runs import services
from labweb.runs.models import Outbox
from labweb.runs.services import driver_switches
from tests.builders import Bench, Edge, a_lab, a_started_run, an_edge, catalog, dispatched, next_job
from tests.labweb.enrollment.driver_texts import approved, proposed, timer
from tests.labweb.web import call, read, signed_in

PUMP = "drivers.connectors.tricontinent_c3000"


def a_pump(bench: Bench, change: str = "", **texts: str) -> DriverVersion:
    """Approve another version of the starter lab's pump."""
    text = catalog()[f"{PUMP}:TricontinentC3000"].sources[PUMP] + f"\n# {change or 'new'}\n"
    for old, new in texts.items():
        text = text.replace(old, new)
    row = approval_services.submit_driver(PUMP, text, note="", actor=bench.people["admin"])
    return approval_services.decide_driver(
        row.id, actor=bench.people["approver"], is_approved=True, comment=""
    )


def want(bench: Bench, key: str, version: DriverVersion) -> Device:
    return driver_replacement.replace_driver(
        bench.device(key).id, version.id, actor=bench.people["admin"], reason="better"
    )


def ready(edge: Edge, device: Device, version: DriverVersion) -> None:
    edge.report("driver_ready", None, device_id=str(device.id), digest=version.digest)


def digest_sent(action_id: UUID) -> str:
    return str(Outbox.objects.get(action_id=action_id, kind="do").body["driver_digest"])


def test_a_version_is_staged_made_ready_and_switched(bench: Bench) -> None:
    edge, version = an_edge(bench), approved(bench, timer())
    before = bench.device("timer_1").driver
    device = want(bench, "timer_1", version)
    assert (device.driver, device.next_driver) == (before, version)
    told = enrollment_services.devices_of(edge.host_id, edge.epoch)
    assert told is not None
    assert [one.digest for one in told.staged] == [version.digest]
    assert before.digest in {one.digest for one in told.devices}
    ready(edge, device, version)
    device = bench.device("timer_1")
    assert (device.driver, device.next_driver, device.is_next_ready) == (version, None, False)


def test_the_job_that_acts_ends_on_the_version_before_and_the_next_begins_on_the_new_one(
    bench: Bench,
) -> None:
    run, edge = a_started_run(bench), an_edge(bench)
    first = dispatched(run)
    key = first.job.device.key
    before = bench.device(key).driver
    version = a_pump(bench)
    edge.begin(first)
    device = want(bench, key, version)
    ready(edge, device, version)
    assert bench.device(key).driver == before, "it acts still"
    services.dispatch_ready()
    edge.report("actuated", first.id, report={"ok": True})
    assert bench.device(key).driver == before
    edge.finish(first)
    assert bench.device(key).driver == version
    edge.work_off(run)
    run.refresh_from_db()
    assert run.state == "complete"
    assert digest_sent(first.id) == before.digest
    later = [
        job.attempts.get().id for job in run.jobs.filter(device__key=key).order_by("index")[1:]
    ]
    assert later
    assert {digest_sent(one) for one in later} == {version.digest}


def test_a_version_that_the_host_cannot_build_leaves_the_one_before_in_place(bench: Bench) -> None:
    edge, version = an_edge(bench), approved(bench, timer())
    before = bench.device("timer_1").driver
    device = want(bench, "timer_1", version)
    edge.report(
        "driver_refused",
        None,
        device_id=str(device.id),
        digest=version.digest,
        code="driver.import",
        message="NameError: name 'x' is not defined",
    )
    device = bench.device("timer_1")
    assert (device.driver, device.next_driver) == (before, None)
    assert device.driver_problem["code"] == "driver.import"
    assert "NameError" in device.driver_problem["message"]
    assert Ticket.objects.get(code="driver.refused").detail["digest"] == version.digest
    assert want(bench, "timer_1", version).driver_problem == {}, "it may be tried again"


def test_an_earlier_version_rolls_back_and_the_present_one_takes_back_what_is_staged(
    bench: Bench,
) -> None:
    edge, version = an_edge(bench), approved(bench, timer())
    release = bench.device("timer_1").driver
    ready(edge, want(bench, "timer_1", version), version)
    assert bench.device("timer_1").driver == version
    ready(edge, want(bench, "timer_1", release), release)
    assert bench.device("timer_1").driver == release
    want(bench, "timer_1", version)
    assert want(bench, "timer_1", release).next_driver is None
    with pytest.raises(StateError) as refusal:
        want(bench, "timer_1", release)
    assert refusal.value.code == "driver.known"


def test_only_an_approved_version_is_given_to_a_device(bench: Bench) -> None:
    version = proposed(bench, timer())
    with pytest.raises(StateError) as refusal:
        want(bench, "timer_1", version)
    assert refusal.value.code == "driver.not_approved"


def test_every_reason_why_a_version_does_not_fit_is_listed(bench: Bench) -> None:
    """A timer cannot take the place of a pump, whose run goes on."""
    a_started_run(bench)
    with pytest.raises(PreconditionError) as refusal:
        want(bench, "pump_1", approved(bench, timer()))
    codes = {finding.code for finding in refusal.value.findings}
    assert {"driver.role_lost", "driver.other_line", "driver.still_needed"} <= codes
    assert "driver.argument_unknown" in codes
    assert bench.device("pump_1").next_driver is None


def test_a_version_with_other_parts_than_the_lab_has_is_refused_with_each(bench: Bench) -> None:
    """A pump that says nothing of its valve any more leaves the valve behind."""
    version = a_pump(bench, "alone", **{"Config], Pump, Valve)": "Config], Pump)"})
    with pytest.raises(PreconditionError) as refusal:
        want(bench, "pump_1", version)
    lost = {one.subject for one in refusal.value.findings if one.code == "driver.parts_lost"}
    assert lost == {"pump_1_valve", "pump_1.outlet"}
    assert bench.device("pump_1").next_driver is None


def test_a_version_that_lost_an_action_is_refused_while_a_run_needs_it(bench: Bench) -> None:
    version = a_pump(bench, "smaller", **{"Range(0.001, 100_000.0)": "Range(0.001, 1.0)"})
    a_started_run(bench)
    with pytest.raises(PreconditionError) as refusal:
        want(bench, "pump_1", version)
    found = [one for one in refusal.value.findings if one.code == "driver.still_needed"]
    assert any("at most 1" in one.message for one in found)


def rest(name: str) -> dict[str, str]:
    """Give the timer an action that is in no interface, with this argument."""
    first = "    def _waited_s("
    text = (
        "    @action(timeout_s=604_860.0)\n"
        f"    def rest(self, {name}: float) -> Report:\n"
        '        """Wait as well."""\n'
        f"        return self.wait({name})\n\n"
    )
    return {first: text + first}


def test_a_limit_that_a_person_set_does_not_fall_away_with_a_renamed_argument(
    bench: Bench,
) -> None:
    """What was admitted for a minute may not wait a week because its number has another name."""
    before, version = (approved(bench, timer(4, **rest(name))) for name in ("length_s", "pause_s"))
    limits = {"wait": {"duration_s": 60.0}, "rest": {"length_s": 60.0}}
    Device.objects.filter(key="timer_1").update(driver=before, admission=limits)
    with pytest.raises(PreconditionError) as refusal:
        want(bench, "timer_1", version)
    assert [one.code for one in refusal.value.findings] == ["driver.limit_lost"]
    assert bench.device("timer_1").next_driver is None
    assert want(bench, "timer_1", approved(bench, timer(5, **rest("length_s")))).next_driver
    Device.objects.filter(key="timer_1").update(state="suspended")
    assert want(bench, "timer_1", version).driver == version, "it has to be admitted anew"


def test_a_version_is_locked_while_a_device_is_given_it(bench: Bench) -> None:
    """Withdrawing it at the same moment waits, and then finds the device."""
    version = approved(bench, timer())
    with CaptureQueriesContext(connection) as queries:
        want(bench, "timer_1", version)
    locking = [one["sql"] for one in queries if "FOR NO KEY UPDATE" in one["sql"]]
    assert any('FROM "enrollment_driverversion"' in sql for sql in locking)


@pytest.mark.parametrize("role", ["observer", "chemist", "approver"])
def test_only_who_admits_devices_replaces_their_drivers(bench: Bench, role: str) -> None:
    version = approved(bench, timer())
    with pytest.raises(ForbiddenError):
        driver_replacement.replace_driver(
            bench.device("timer_1").id, version.id, actor=bench.people[role], reason="x"
        )
    with pytest.raises(DefinitionError) as refusal:
        driver_replacement.replace_driver(
            bench.device("timer_1").id, version.id, actor=bench.people["admin"], reason=" "
        )
    assert refusal.value.code == "driver.no_reason"


def test_a_word_about_a_version_that_nobody_wants_any_more_changes_nothing(bench: Bench) -> None:
    edge, version = an_edge(bench), approved(bench, timer())
    device = bench.device("timer_1")
    ready(edge, device, version)
    body = {"device_id": str(device.id), "digest": version.digest, "code": "c", "message": "m"}
    edge.report("driver_refused", None, **body)
    device = bench.device("timer_1")
    assert (device.driver_problem, device.is_next_ready) == ({}, False)


def test_the_device_tells_over_rest_which_version_it_has_and_is_to_have(bench: Bench) -> None:
    version = approved(bench, timer())
    client, path = signed_in(bench.people["admin"]), f"devices/{bench.device('timer_1').id}"
    body = {"version_id": str(version.id), "reason": "better"}
    answer = json.loads(call(client, "POST", f"/api/v1/{path}/driver", body).content)
    assert answer["next"] == {
        "version_id": str(version.id),
        "digest": version.digest,
        "is_ready": False,
    }
    shown = json.loads(call(client, "GET", f"/api/v1/{path}").content)["driver"]
    assert shown["next"]["digest"] == version.digest


def test_which_version_serves_is_what_the_host_says_of_its_own_devices(bench: Bench) -> None:
    edge, device = an_edge(bench), bench.device("timer_1")
    other = bench.device("heater_1")
    said = {str(device.id): device.driver.digest}
    enrollment_services.note_serving(edge.host_id, edge.epoch + 1, said)
    assert bench.device("timer_1").serving == {}, "another session's word counts nothing"
    enrollment_services.note_serving(edge.host_id, edge.epoch, said)
    first = bench.device("timer_1").serving
    assert (first["digest"], first["host_id"]) == (device.driver.digest, str(edge.host_id))
    enrollment_services.note_serving(edge.host_id, edge.epoch, said)
    assert bench.device("timer_1").serving == first, "since when it does stays"
    client = signed_in(bench.people["observer"])
    shown = read(client, f"/api/v1/devices/{device.id}")["driver"]["serving"]
    assert (shown["digest"], shown["is_present"]) == (device.driver.digest, True)
    assert read(client, f"/api/v1/devices/{other.id}")["driver"]["serving"] is None
    enrollment_services.note_serving(edge.host_id, edge.epoch, {str(device.id): "0" * 64})
    shown = read(client, f"/api/v1/devices/{device.id}")["driver"]["serving"]
    assert shown["is_present"] is False
    enrollment_services.note_serving(edge.host_id, edge.epoch, {})
    assert bench.device("timer_1").serving == {}


def test_the_command_that_switches_a_device_goes_to_the_version_after(bench: Bench) -> None:
    run, _ = a_started_run(bench), an_edge(bench)
    key = next_job(run).device.key
    version = a_pump(bench)
    Device.objects.filter(key=key).update(next_driver=version, is_next_ready=True)
    attempt = dispatched(run)
    assert bench.device(key).driver == version
    assert digest_sent(attempt.id) == version.digest


@pytest.mark.django_db(transaction=True)
def test_nobody_takes_a_version_back_while_it_takes_over(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = a_lab()
    edge, version = an_edge(bench), a_pump(bench)
    device = want(bench, "pump_1", version)
    asked: list[str] = []
    real = driver_switches.is_acting

    def take_back() -> None:
        try:
            with atomic():
                Device.objects.select_for_update(nowait=True).get(pk=device.pk)
            asked.append("free")
        except OperationalError:
            asked.append("locked")
        finally:
            connection.close()

    def between(row: Device) -> bool:
        thread = threading.Thread(target=take_back)
        thread.start()
        thread.join()
        return real(row)

    monkeypatch.setattr(driver_switches, "is_acting", between)
    ready(edge, device, version)
    assert asked == ["locked"]
    assert bench.device("pump_1").driver == version


@pytest.mark.parametrize("state", ["candidate", "suspended"])
def test_a_device_that_is_not_admitted_is_switched_under_the_lock_of_its_host(
    bench: Bench, state: str
) -> None:
    version = approved(bench, timer())
    Device.objects.filter(key="timer_1").update(state=state)
    with CaptureQueriesContext(connection) as queries:
        assert want(bench, "timer_1", version).driver == version
    locking = [one["sql"] for one in queries if "FOR NO KEY UPDATE" in one["sql"]]
    assert 'FROM "enrollment_edgehost"' in locking[0], "before the device, as a dispatch does"


def test_a_suspended_device_ends_what_it_does_on_the_version_before(bench: Bench) -> None:
    run, edge = a_started_run(bench), an_edge(bench)
    first = dispatched(run)
    key = first.job.device.key
    before, version = bench.device(key).driver, a_pump(bench)
    edge.begin(first)
    enrollment_services.suspend_device(
        bench.device(key).id, actor=bench.people["admin"], reason="it rattles"
    )
    assert want(bench, key, version).driver == before, "it acts still"
    edge.report("actuated", first.id, report={"ok": True})
    edge.finish(first)
    assert bench.device(key).driver == version


@pytest.mark.django_db(transaction=True)
@pytest.mark.parametrize("act", ["want", "ready"])
def test_a_run_that_names_a_device_waits_for_no_change_of_its_driver(
    monkeypatch: pytest.MonkeyPatch, act: str
) -> None:
    """Both write into the chain of the audit: who waited for the other would wait for ever."""
    bench = a_lab()
    edge, version = an_edge(bench), a_pump(bench)
    device = want(bench, "pump_1", version) if act == "ready" else bench.device("pump_1")
    asked: list[str] = []
    real = account_services.write_audit

    def name_it() -> None:
        try:
            with atomic(), connection.cursor() as cursor:
                key = "SELECT 1 FROM {} WHERE id = %s FOR KEY SHARE NOWAIT"
                cursor.execute(key.format("enrollment_device"), [device.pk])
                cursor.execute(key.format("enrollment_driverversion"), [version.pk])
            asked.append("free")
        except OperationalError:
            asked.append("locked")
        finally:
            connection.close()

    def meanwhile(*args: Any, **fields: Any) -> object:  # noqa: ANN401 - as the real one
        thread = threading.Thread(target=name_it)
        thread.start()
        thread.join()
        return real(*args, **fields)

    monkeypatch.setattr(account_services, "write_audit", meanwhile)
    if act == "want":
        want(bench, "pump_1", version)
    else:
        ready(edge, device, version)
    assert asked == ["free"]
