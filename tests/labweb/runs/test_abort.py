"""An aborted run halts what acts and all that it has set, and shows how far that has come."""

from __future__ import annotations

import json
from datetime import timedelta
from typing import Any
from uuid import UUID

import pytest

from labweb.accounts.models import AuditEntry
from labweb.common.clock import now
from labweb.crutd import selectors as crutd_selectors
from labweb.domain.errors import Effect
from labweb.domain.runs.halts import halted_setpoints
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.domain.runs.host_journal.journal_rows import ActionRow
from labweb.enrollment.models import Device, EdgeHost
from labweb.fleet.services import fencing
from labweb.resources import selectors as resource_selectors
from labweb.runs import services
from labweb.runs.models import DeviceHalt, Job, Outbox, Run
from tests.builders import Bench, a_started_run
from tests.labweb.runs.hosts import Host, a_heating_run, hear_stop, states
from tests.labweb.runs.promises import keeps
from tests.labweb.web import call, signed_in

WARM = {"temperature_c": 41.5}
HALTED = ActionReport(
    ok=False, effect=Effect.PARTIAL, code="device.stopped", message="stopped", evidence=WARM
)
STANDS = "its device was halted, and stands"


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


@pytest.fixture
def run(bench: Bench) -> Run:
    return a_heating_run(bench)


def until_acting(host: Host, action: str) -> ActionRow:
    """Carry out what comes before an action, and be in the middle of it."""
    while True:
        services.dispatch_ready()
        host.take()
        row = host.begin()
        host.tell()
        if row.do.action == action:
            return row
        host.end(row, ActionReport(ok=True))
        host.tell()


def is_cancelled(host: Host, row: ActionRow) -> bool:
    return host.disk.actions[row.action_id].is_cancel_wanted


def abort(bench: Bench, run: Run) -> None:
    services.abort_run(run.id, actor=bench.people["chemist"], reason="it smells")


def shown(bench: Bench, run: Run) -> dict[str, Any]:
    found: dict[str, Any] = signed_in(bench.people["chemist"]).get(f"/api/v1/runs/{run.id}").json()
    return found


def halts(bench: Bench, run: Run) -> list[tuple[str, str]]:
    return [(one["state"], one["message"]) for one in shown(bench, run)["halts"]]


def state(run: Run) -> str:
    return Run.objects.get(pk=run.pk).state


def cut_off(host: Host, row: ActionRow) -> None:
    """Halt a device with its action, as its line does, and end that."""
    host.end(row, HALTED, is_halted=True)
    host.tell()


@keeps(
    "The run ends here; its record stays.",
)
def test_an_abort_halts_what_acts_and_the_run_ends_once_the_device_stands(
    bench: Bench, host: Host, run: Run
) -> None:
    row = until_acting(host, "hold")
    abort(bench, run)
    host.take()
    assert is_cancelled(host, row)
    assert host.disk.host_state("").owes_halt == {str(bench.device("heater_1").id)}
    host.tell()
    assert (state(run), halts(bench, run)) == ("running", [("taken", "")])
    cut_off(host, row)
    assert state(run) == "running", "nobody has said yet that it stands"
    host.halt_owed()
    host.tell()
    assert (state(run), halts(bench, run)) == ("aborted", [("halted", STANDS)])
    assert not Outbox.objects.filter(settled_at__isnull=True).exists()


@keeps(
    "What acts is halted within seconds, and the record says how far it came.",
)
def test_the_record_of_an_action_that_was_cut_off_says_how_far_it_came(
    bench: Bench, host: Host, run: Run
) -> None:
    row = until_acting(host, "heat_to")
    abort(bench, run)
    host.take()
    cut_off(host, row)
    job = Job.objects.get(run=run, action="heat_to")
    assert (job.state, job.code) == ("aborted", "device.stopped"), "nothing of it is in doubt"
    assert job.evidence["report"]["evidence"] == {"temperature_c": 41.5}
    assert bench.node("heater_1").data.get("temperature_setpoint_c") is None


@keeps(
    "Heaters, stirrers, pumps and supplies that this run has set are switched off, too, "
    "unless another run works with them."
)
def test_a_device_that_an_earlier_step_left_on_is_halted_though_nothing_acts_on_it(
    bench: Bench, host: Host, run: Run
) -> None:
    until = until_acting(host, "heat_to")
    host.end(until, ActionReport(ok=True))
    host.tell()
    assert bench.node("heater_1").data["temperature_setpoint_c"] == 60.0
    abort(bench, run)
    host.take()
    host.halt_owed()
    host.tell()
    assert (state(run), halts(bench, run)) == ("aborted", [("halted", STANDS)])
    assert bench.node("heater_1").data["temperature_setpoint_c"] is None


def test_an_action_that_completes_as_it_is_cancelled_leaves_nothing_on(
    bench: Bench, host: Host, run: Run
) -> None:
    row = until_acting(host, "stir")
    abort(bench, run)
    DeviceHalt.objects.all().delete()
    Outbox.objects.filter(kind__in=["halt", "cancel"]).delete()
    host.end(row, ActionReport(ok=True))
    host.tell()
    assert [one.state for one in run.halts.all()] == ["asked"], "it turns, and its run is over"
    assert state(run) == "running"


@keeps(
    "A device that does not answer is halted as soon as it answers. "
    "This page shows which one that is."
)
def test_a_device_that_does_not_answer_owes_its_halt_and_the_run_ends(
    bench: Bench, host: Host, run: Run
) -> None:
    row = until_acting(host, "hold")
    abort(bench, run)
    host.take()
    cut_off(host, row)
    heater = bench.device("heater_1")
    with host.write() as tx:
        halted_setpoints.note_waiting(tx, heater.id, "it does not answer")
    host.tell()
    assert (state(run), halts(bench, run)) == ("aborted", [("owed", "it does not answer")])
    client = signed_in(bench.people["observer"])
    tile = client.get(f"/api/v1/devices/{heater.id}").json()
    assert tile["is_halt_owed"]
    assert tile["halt"]["run"]["number"] == run.number
    needs = client.get("/api/v1/home").json()["needs_you"]
    told = [(one["title"], one["detail"]) for one in needs if one["kind"] == "halt_owed"]
    assert told == [(f"{heater.name} could not be halted yet", "it does not answer")]
    host.halt_owed()
    host.tell()
    assert halts(bench, run) == [("halted", STANDS)]
    page = client.get(f"/api/v1/devices/{heater.id}").json()
    assert not page["is_halt_owed"]
    assert (page["halt"]["state"], page["halt"]["message"]) == ("halted", STANDS)


def test_a_halt_is_carried_out_when_its_host_comes_back(bench: Bench, host: Host, run: Run) -> None:
    until = until_acting(host, "heat_to")
    host.end(until, ActionReport(ok=True))
    host.tell()
    EdgeHost.objects.update(state="isolated")
    abort(bench, run)
    assert (state(run), halts(bench, run)[0][0]) == ("aborted", "owed")
    host.reconnect()
    host.take()
    host.halt_owed()
    host.tell()
    assert halts(bench, run) == [("halted", STANDS)]


def test_a_run_does_not_wait_for_a_host_that_tells_nothing(
    bench: Bench, host: Host, run: Run
) -> None:
    until = until_acting(host, "heat_to")
    host.end(until, ActionReport(ok=True))
    host.tell()
    abort(bench, run)
    assert services.note_silence() == 0
    assert state(run) == "running"
    DeviceHalt.objects.update(at=now() - timedelta(seconds=20))
    assert services.note_silence() == 1
    assert (state(run), halts(bench, run)[0][0]) == ("aborted", "owed")


def test_a_second_abort_changes_nothing_and_says_what_is_under_way(
    bench: Bench, host: Host, run: Run
) -> None:
    until_acting(host, "hold")
    abort(bench, run)
    sent = Outbox.objects.count()
    chemist = signed_in(bench.people["chemist"])
    answer = call(chemist, "POST", f"/api/v1/runs/{run.id}/abort", {"reason": "x"})
    told = json.loads(answer.content)
    assert (answer.status_code, told["is_given_up"], len(told["halts"])) == (200, True, 1)
    assert Outbox.objects.count() == sent
    for act in ("pause", "resume"):
        path = f"/api/v1/runs/{run.id}/{act}"
        refused = call(signed_in(bench.people["chemist"]), "POST", path, {})
        assert (refused.status_code, json.loads(refused.content)["code"]) == (409, "run.aborting")


def test_a_run_behind_waits_for_the_halt_and_then_goes_on(
    bench: Bench, host: Host, run: Run
) -> None:
    until = until_acting(host, "heat_to")
    host.end(until, ActionReport(ok=True))
    host.tell()
    behind = a_heating_run(bench)
    abort(bench, run)
    services.dispatch_ready()
    assert set(states(behind)) == {"queued"}, "its heater is to be halted first"
    host.take()
    host.halt_owed()
    host.tell()
    services.dispatch_ready()
    assert "dispatched" in states(behind)


@keeps(
    "Heaters, stirrers, pumps and supplies that this run has set are switched off, too, "
    "unless another run works with them."
)
def test_a_device_that_works_for_another_run_is_left_alone_and_that_is_said(
    bench: Bench, host: Host, run: Run
) -> None:
    while run.jobs.filter(state="complete").count() < 2:
        services.dispatch_ready()
        host.take()
        host.end(host.begin(), ActionReport(ok=True))
        host.tell()
    other = a_heating_run(bench)
    Job.objects.filter(run=run, action="stir").update(run=other, index=99)
    abort(bench, run)
    assert halts(bench, run) == [("kept", f"run #{other.number} works with it")]
    assert not Outbox.objects.filter(kind="halt").exists()
    assert state(run) == "aborted"


@keeps(
    "No further action of this run starts.",
)
def test_what_its_host_gives_back_of_an_aborted_run_is_not_sent_again(
    bench: Bench, host: Host, run: Run
) -> None:
    services.dispatch_ready()
    host.take()
    host.tell()
    services.pause_run(run.id, actor=bench.people["chemist"])
    services.stop_lab(actor=bench.people["chemist"])
    abort(bench, run)
    host.take()
    host.tell()
    assert set(states(run)) <= {"stopped", "complete"}
    assert state(run) == "aborted"


@keeps(
    "What is in doubt stays so until a person has answered.",
)
def test_a_run_that_is_aborted_ends_though_one_of_its_actions_is_in_doubt(
    bench: Bench, host: Host, run: Run
) -> None:
    row = until_acting(host, "heat_to")
    host.end(row, ActionReport(ok=False, effect=Effect.UNKNOWN, code="device.timeout"))
    host.tell()
    abort(bench, run)
    host.take()
    host.halt_owed()
    host.tell()
    assert (state(run), halts(bench, run)) == ("aborted", [("halted", STANDS)])
    job = Job.objects.get(run=run, action="heat_to")
    assert job.state == "in_doubt"
    services.resolve_job(
        job.id, actor=bench.people["chemist"], answer="did_not", moved_nl=None, note="cold"
    )
    host.take()
    host.tell()
    assert Job.objects.get(pk=job.pk).state == "aborted"
    assert state(run) == "aborted"


def test_a_device_that_an_action_given_up_may_have_set_is_halted(
    bench: Bench, host: Host, run: Run
) -> None:
    row = until_acting(host, "heat_to")
    host.end(row, ActionReport(ok=False, effect=Effect.UNKNOWN, code="device.timeout"))
    host.tell()
    chemist, job = bench.people["chemist"], Job.objects.get(run=run, action="heat_to")
    services.resolve_job(job.id, actor=chemist, answer="discard", moved_nl=None, note="dark")
    host.take()
    host.tell()
    abort(bench, run)
    assert halts(bench, run) == [("asked", "")]


def test_halts_that_a_lost_journal_had_are_asked_for_again(
    bench: Bench, host: Host, run: Run
) -> None:
    until = until_acting(host, "heat_to")
    host.end(until, ActionReport(ok=True))
    host.tell()
    abort(bench, run)
    host.take()
    host.tell()
    fencing.quarantine(bench.host, "host.gap", "its log has a gap")
    assert Outbox.objects.get(kind="halt").settled_at is None
    assert (state(run), halts(bench, run)[0][0]) == ("aborted", "owed")


@keeps("Liquid stays where it is.")
def test_liquid_stays_where_it_was_when_its_transfer_was_aborted(bench: Bench, host: Host) -> None:
    run = a_started_run(bench)
    row = until_acting(host, "aspirate")
    operation = row.do.operation
    syringe, asked_nl = UUID(operation["target_id"]), operation["amount_nl"]
    source = UUID(operation["source_id"])
    before = sum(host.disk.resources[source].view.contents.values())
    abort(bench, run)
    host.take()
    told = ActionReport(
        ok=False, effect=Effect.PARTIAL, code="device.stopped", moved_nl=asked_nl // 3
    )
    host.end(row, told, is_halted=True)
    host.halt_owed()
    host.tell()
    assert state(run) == "aborted"
    rows = {entry.pk: entry for entry in resource_selectors.rows([syringe, source])}
    found = crutd_selectors.snapshot(list(rows.values()))
    assert sum(found[syringe].contents.values()) == asked_nl // 3
    assert sum(found[source].contents.values()) == before - asked_nl // 3


@keeps(
    "What is under way goes on to its end. "
    "No further action starts before somebody resumes the run."
)
def test_a_pause_lets_what_acts_end_and_nothing_begin(bench: Bench, host: Host, run: Run) -> None:
    row = until_acting(host, "stir")
    services.pause_run(run.id, actor=bench.people["chemist"])
    host.take()
    assert not is_cancelled(host, row)
    host.end(row, ActionReport(ok=True))
    host.tell()
    assert Job.objects.get(run=run, action="stir").state == "complete"
    assert services.dispatch_ready() == 0
    services.resume_run(run.id, actor=bench.people["chemist"])
    assert services.dispatch_ready() == 1


@keeps(
    "Software stop. Use the red button on the bench in an emergency.",
    "Runs stay paused until somebody resumes them. Your reason is kept.",
)
def test_a_stop_of_the_lab_halts_all_and_after_its_reset_runs_stay_paused(
    bench: Bench, host: Host, run: Run
) -> None:
    row = until_acting(host, "stir")
    services.stop_lab(actor=bench.people["observer"])
    hear_stop(bench, host)
    assert is_cancelled(host, row)
    assert len(host.disk.host_state("").owes_halt) == len(Device.objects.filter(state="enrolled"))
    cut_off(host, row)
    host.halt_owed()
    services.reset_lab(actor=bench.people["approver"], reason="looked at every device")
    host.take()
    host.tell()
    assert state(run) == "paused"
    assert services.dispatch_ready() == 0
    kept = AuditEntry.objects.filter(action="lab.reset").latest("id")
    assert kept.reason == "looked at every device"
