"""A set-point that is gone by itself: told by the host, and its run is asked about it."""

from __future__ import annotations

from datetime import datetime

import msgspec
import pytest

from labweb.crutd.models import Event, Ticket
from labweb.domain.enrollment.setpoint_readback import kept_by
from labweb.domain.errors import StateError
from labweb.domain.messages.devices_and_drivers import DeviceConfig
from labweb.domain.runs.halts import halted_setpoints, vanished_setpoints
from labweb.domain.runs.halts.standing_setpoints import StandingSetpoint, read_stands
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.records.services.ledger_rebuild import differences
from labweb.runs import services
from labweb.runs.models import DeviceHalt, Job, Run
from labweb.runs.selectors import lab_summary
from labweb.workflows import services as workflow_services
from tests.builders import Bench
from tests.labweb.runs.hosts import Host, a_heating_run
from tests.labweb.web import signed_in


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


@pytest.fixture
def run(bench: Bench) -> Run:
    return a_heating_run(bench)


def until_the_hold(host: Host) -> None:
    """Heat and stir, and be in the middle of the hold."""
    while True:
        services.dispatch_ready()
        host.take()
        row = host.begin()
        if row.do.action == "hold":
            host.tell()
            return
        host.end(row, ActionReport(ok=True))
        host.tell()


def lose(host: Host, bench: Bench, sort: str, found: float) -> bool:
    """Have the host see in its readings that what stands of a sort is gone."""
    device = bench.device("heater_1")
    stands = read_stands(host.disk.meta)[device.id][sort]
    kept = kept_by(stands.action, stands.args, ["temperature_setpoint_c", "speed_setpoint_rpm"])[0]
    with host.write() as tx:
        return vanished_setpoints.write_vanished(tx, served(host, bench), stands, kept, found)


def served(host: Host, bench: Bench) -> DeviceConfig:
    devices = msgspec.json.decode(host.disk.meta["devices"], type=list[DeviceConfig])
    return next(one for one in devices if one.id == bench.device("heater_1").id)


def stirring(run: Run) -> Job:
    return Job.objects.get(run=run, action="stir")


def test_a_stirrer_that_was_reset_between_steps_pauses_its_run_and_asks_about_the_step(
    bench: Bench, host: Host, run: Run
) -> None:
    until_the_hold(host)
    assert lose(host, bench, "motion", 0.0)
    host.tell()
    run.refresh_from_db()
    job = stirring(run)
    assert job.halted_by == "edge.setpoint_lost"
    assert job.message.startswith("the speed set-point reads 0 rpm; 400 rpm was set")
    assert [one["kind"] for one in run.pause_reasons] == ["lost"]
    assert Job.objects.get(run=run, action="heat_to").halted_by == "", "the heat still stands"
    shown = signed_in(bench.people["chemist"]).get(f"/api/v1/runs/{run.id}").json()
    card = next(one for one in shown["jobs"] if one["id"] == str(job.id))["recovery"]
    offered = [one["name"] for one in card["choices"] if not one["why_not"]]
    assert offered == ["retry", "skip"]


def test_the_run_is_not_resumed_before_somebody_has_said_what_becomes_of_the_step(
    bench: Bench, host: Host, run: Run
) -> None:
    until_the_hold(host)
    lose(host, bench, "motion", 0.0)
    host.tell()
    with pytest.raises(StateError) as refusal:
        services.resume_run(run.id, actor=bench.people["chemist"])
    assert refusal.value.code == "run.halted"
    assert "does not keep what was set" in refusal.value.message


def test_the_record_says_that_what_was_set_is_unknown_and_why_at_host_and_server(
    bench: Bench, host: Host, run: Run
) -> None:
    until_the_hold(host)
    assert bench.node("heater_1").data["speed_setpoint_rpm"] == 400.0
    lose(host, bench, "motion", 0.0)
    host.tell()
    row = bench.node("heater_1")
    view = host.disk.resources[row.id].view
    assert row.data["speed_setpoint_rpm"] is None
    assert row.data["temperature_setpoint_c"] is not None, "the heat still stands"
    assert (view.rev, view.data) == (row.rev, row.data)
    assert differences(bench.lab) == []
    assert not Ticket.objects.exists()
    event = Event.objects.filter(body__code="edge.setpoint_lost").latest("seq")
    assert "reads 0 rpm; 400 rpm was set" in event.body["message"]


def test_a_loss_is_told_once_and_not_while_another_action_of_its_sort_acts(
    bench: Bench, host: Host, run: Run
) -> None:
    until_the_hold(host)
    device_id = bench.device("heater_1").id
    heat = read_stands(host.disk.meta)[device_id]["heat"]
    assert not lose(host, bench, "heat", 0.0), "the hold that acts reads it back itself"
    assert read_stands(host.disk.meta)[device_id]["heat"] == heat
    stands = read_stands(host.disk.meta)[device_id]["motion"]
    assert lose(host, bench, "motion", 0.0)
    assert "motion" not in read_stands(host.disk.meta)[device_id]
    kept = kept_by("stir", stands.args, ["speed_rpm"])[0]
    with host.write() as tx:
        assert not vanished_setpoints.write_vanished(tx, served(host, bench), stands, kept, 0.0)


def test_a_halt_of_the_device_leaves_nothing_that_could_vanish(
    bench: Bench, host: Host, run: Run
) -> None:
    until_the_hold(host)
    assert read_stands(host.disk.meta)
    with host.write() as tx:
        halted_setpoints.write_halts(tx, halted_setpoints.STOPPED)
    assert not read_stands(host.disk.meta)


def test_another_actions_word_changes_nothing_but_what_it_names(
    bench: Bench, host: Host, run: Run
) -> None:
    until_the_hold(host)
    stale = StandingSetpoint(action_id=run.id, action="stir", args={"speed_rpm": 1.0})
    kept = kept_by("stir", stale.args, ["speed_rpm"])[0]
    with host.write() as tx:
        assert not vanished_setpoints.write_vanished(tx, served(host, bench), stale, kept, 0.0)
    host.tell()
    run.refresh_from_db()
    assert run.pause_reasons == []


def until_heated(host: Host) -> None:
    """Stir and heat; nothing acts any more, and the hold has not begun."""
    for _ in range(2):
        services.dispatch_ready()
        host.take()
        host.end(host.begin(), ActionReport(ok=True))
        host.tell()


@pytest.mark.parametrize("goes_on", [False, True])
def test_an_abort_halts_a_device_that_has_lost_what_was_set_for_it_may_be_set_to_anything(
    bench: Bench,
    host: Host,
    run: Run,
    goes_on: bool,
) -> None:
    until_heated(host)
    assert lose(host, bench, "heat", 120.0)
    assert lose(host, bench, "motion", 900.0)
    host.tell()
    chemist = bench.people["chemist"]
    for job in Job.objects.filter(run=run, halted_by="edge.setpoint_lost") if goes_on else ():
        services.recover_job(job.id, actor=chemist, choice="skip", note="warm enough")
    services.abort_run(run.id, actor=chemist, reason="it smells")
    assert DeviceHalt.objects.get(run=run).device == bench.device("heater_1")
    assert DeviceHalt.objects.get(run=run).state == "asked"


def a_run_that_leaves_the_stirrer_on(bench: Bench) -> Run:
    params = {"vessel": str(bench.node("reactor_1").id), "stir_speed": "400 rpm"}
    step = {"id": "s", "kind": "start_stir", "params": params, "position": {"x": 0, "y": 0}}
    chemist = bench.people["chemist"]
    workflow = workflow_services.create_workflow(
        bench.lab,
        name="Stir on",
        document={"schema": "labweb.workflow/1", "name": "x", "steps": [step], "edges": []},
        actor=chemist,
    )
    version = workflow_services.save_version(workflow.id, note="", actor=chemist)
    return services.start_run(version, actor=chemist)


def test_a_device_that_an_ended_run_left_on_is_watched_and_a_person_asked_to_look(
    bench: Bench, host: Host
) -> None:
    run = a_run_that_leaves_the_stirrer_on(bench)
    services.dispatch_ready()
    host.take()
    host.end(host.begin(), ActionReport(ok=True))
    host.tell()
    run.refresh_from_db()
    assert run.state == "complete"
    assert lose(host, bench, "motion", 900.0)
    host.tell()
    ticket = Ticket.objects.get(code="device.left_on")
    assert ticket.message.startswith(f"run #{run.number} has ended and left Heater 1 on. Now ")
    assert "reads 900 rpm; 400 rpm was set" in ticket.message
    assert stirring(run).halted_by == ""


def test_a_loss_is_told_at_home_and_counted_while_another_action_still_acts(
    bench: Bench, host: Host, run: Run
) -> None:
    until_the_hold(host)
    before = lab_summary(bench.lab).counts.needs_you
    lose(host, bench, "motion", 0.0)
    host.tell()
    run.refresh_from_db()
    assert run.state == "pausing", "the hold has not ended"
    assert lab_summary(bench.lab).counts.needs_you == before + 1
    needs = signed_in(bench.people["chemist"]).get("/api/v1/home").json()["needs_you"]
    [need] = [one for one in needs if one["run_id"] == str(run.id)]
    heater = bench.device("heater_1").name
    assert (need["kind"], need["url"]) == ("paused", f"/runs/{run.id}")
    assert need["title"] == f"Run #{run.number} {run.version.workflow.name} is pausing"
    assert need["detail"].startswith(f"{stirring(run).sentence}: {heater} does not keep what was")
    told_at = datetime.fromisoformat(need["since_at"])
    assert told_at == datetime.fromisoformat(run.pause_reasons[0]["at"])


def test_a_run_that_a_person_pauses_waits_for_nobody_while_its_action_acts(
    bench: Bench, host: Host, run: Run
) -> None:
    until_the_hold(host)
    before = lab_summary(bench.lab).counts.needs_you
    services.pause_run(run.id, actor=bench.people["chemist"])
    run.refresh_from_db()
    assert run.state == "pausing"
    assert lab_summary(bench.lab).counts.needs_you == before


def test_a_step_that_somebody_has_answered_for_needs_nobody_any_more(
    bench: Bench, host: Host, run: Run
) -> None:
    until_the_hold(host)
    before = lab_summary(bench.lab).counts.needs_you
    lose(host, bench, "motion", 0.0)
    host.tell()
    chemist = bench.people["chemist"]
    services.recover_job(stirring(run).id, actor=chemist, choice="skip", note="it may rest")
    run.refresh_from_db()
    assert run.state == "pausing"
    assert lab_summary(bench.lab).counts.needs_you == before
