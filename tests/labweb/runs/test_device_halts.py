"""What a halt takes away of what earlier steps had set: in the record, and in their runs."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.crutd.models import Event, Ticket
from labweb.domain.errors import Effect, StateError
from labweb.domain.messages.commands import Cancel
from labweb.domain.runs.halts import halted_setpoints
from labweb.domain.runs.host_actions import action_execution, command_acceptance
from labweb.domain.runs.host_journal.action_states import ActionReport, ActionState
from labweb.domain.runs.host_journal.journal_rows import ActionRow
from labweb.enrollment import services as enrollment_services
from labweb.fleet.services import fencing
from labweb.records.services.ledger_rebuild import differences, rebuild
from labweb.resources import selectors as resource_selectors
from labweb.resources import services as resource_services
from labweb.runs import services
from labweb.runs.models import Attempt, Job, Run
from tests.builders import Bench, Edge
from tests.labweb.crutd.test_verify import tamper
from tests.labweb.runs.hosts import Host, a_heating_run, hear_stop, last_run, states
from tests.labweb.web import call, signed_in

HEAT_AND_STIR = "Heat and stir"
HALTED = ActionReport(ok=False, effect=Effect.NONE, code="device.stopped", message="stopped")
UNKNOWN = ActionReport(ok=False, effect=Effect.UNKNOWN, code="device.timeout", message="no answer")


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


@pytest.fixture
def run(bench: Bench) -> Run:
    return a_heating_run(bench)


def next_one(host: Host) -> None:
    services.dispatch_ready()
    host.take()


def holding(host: Host, run: Run) -> ActionRow:
    """Heat and stir, and be in the middle of the hold."""
    while True:
        next_one(host)
        row = host.begin()
        if row.do.action == "hold":
            host.tell()
            return row
        host.end(row, ActionReport(ok=True))
        host.tell()


def job(run: Run, action: str) -> Job:
    return Job.objects.get(run=run, action=action)


def data(bench: Bench) -> dict[str, Any]:
    found: dict[str, Any] = bench.node("heater_1").data
    return found


def agrees(bench: Bench, host: Host) -> bool:
    """Host and server know the same of the heater, and so do the events."""
    row = bench.node("heater_1")
    view = host.disk.resources[row.id].view
    assert (view.rev, view.data) == (row.rev, row.data)
    return differences(bench.lab) == []


def reset(bench: Bench, host: Host) -> None:
    services.reset_lab(actor=bench.people["approver"], reason="looked at every device")
    host.take()


def stopped(bench: Bench, host: Host, run: Run) -> None:
    """Stop the lab in the middle of the hold, and answer what became of that."""
    row = holding(host, run)
    assert data(bench)["speed_setpoint_rpm"] == 400.0
    services.stop_lab(actor=bench.people["chemist"])
    hear_stop(bench, host)
    host.end(row, HALTED, is_halted=True)
    host.halt_owed()
    host.tell()
    reset(bench, host)
    host.tell()


def choose(bench: Bench, job: Job, choice: str) -> int:
    path = f"/api/v1/jobs/{job.id}/recover"
    wish = {"note": "looked at it", "choice": choice}
    return call(signed_in(bench.people["chemist"]), "POST", path, wish).status_code


def refused(bench: Bench, run: Run) -> StateError:
    with pytest.raises(StateError) as refusal:
        services.resume_run(run.id, actor=bench.people["chemist"])
    return refusal.value


def test_a_stop_voids_what_earlier_steps_had_set_in_host_and_server_and_their_events(
    bench: Bench, host: Host, run: Run
) -> None:
    stopped(bench, host, run)
    assert data(bench)["speed_setpoint_rpm"] is None
    assert data(bench)["temperature_setpoint_c"] is None
    assert agrees(bench, host)
    event = Event.objects.filter(body__code="edge.stopped").latest("seq")
    assert "was halted: the lab was stopped" in event.body["message"]
    assert event.body["job_id"] is None
    assert not Ticket.objects.exists()
    rebuild(bench.lab)
    assert data(bench)["speed_setpoint_rpm"] is None


def test_a_run_is_not_resumed_before_somebody_has_dealt_with_each_step_that_is_undone(
    bench: Bench, host: Host, run: Run
) -> None:
    stopped(bench, host, run)
    assert choose(bench, job(run, "hold"), "retry") == 200
    refusal = refused(bench, run)
    assert refusal.code == "run.halted"
    told = [(one.subject, one.context["device_id"]) for one in refusal.findings]
    heater = bench.device("heater_1")
    assert told == [("heat", str(heater.id))] * 2
    assert all(heater.name in one.message for one in refusal.findings)
    assert choose(bench, job(run, "stir"), "done_by_hand") == 409
    assert choose(bench, job(run, "stir"), "retry") == 200
    assert len(refused(bench, run).findings) == 1
    assert choose(bench, job(run, "heat_to"), "skip") == 200
    services.resume_run(run.id, actor=bench.people["chemist"])
    order = []
    while True:
        next_one(host)
        try:
            row = host.begin()
        except IndexError:
            break
        order.append(row.do.action)
        host.end(row, ActionReport(ok=True))
        host.tell()
    assert order == ["stir", "hold", "stop_heating", "stop_stirring"], (
        "what was done again comes before what counts on it"
    )
    assert Run.objects.get(pk=run.pk).state == "complete"
    assert job(run, "stir").attempts.count() == 2
    assert agrees(bench, host)


def test_a_job_that_is_queued_anew_is_no_difference_and_one_that_was_tampered_with_is(
    bench: Bench, host: Host, run: Run
) -> None:
    stopped(bench, host, run)
    for action in ("stir", "hold"):
        assert choose(bench, job(run, action), "retry") == 200
    assert (job(run, "stir").state, job(run, "hold").state) == ("queued", "queued")
    assert differences(bench.lab) == []
    tamper("UPDATE runs_job SET state = 'complete' WHERE action = 'hold'")
    assert [one.code for one in differences(bench.lab)] == ["rebuild.job"]
    rebuild(bench.lab)
    assert (job(run, "stir").state, job(run, "hold").state) == ("queued", "queued")


def test_the_card_of_a_step_that_a_stop_undid_offers_it_again_or_to_go_on_without(
    bench: Bench, host: Host, run: Run
) -> None:
    stopped(bench, host, run)
    shown = signed_in(bench.people["chemist"]).get(f"/api/v1/runs/{run.id}").json()
    card = next(one for one in shown["jobs"] if one["action"] == "stir")
    told = (card["state"], card["halted_by"], card["is_halt_certain"])
    assert told == ("complete", "edge.stopped", True)
    offered = [one["name"] for one in card["recovery"]["choices"] if one["why_not"] is None]
    assert offered == ["retry", "skip"]
    assert shown["can"]["resume"] is False
    assert [one["kind"] for one in shown["pause_reasons"]] == ["stopped", "halted"]
    for action in ("hold", "stir", "heat_to"):
        assert last_run(bench, run)["waits_for"] == "recovery"
        assert choose(bench, job(run, action), "skip") == 200
    assert last_run(bench, run)["waits_for"] is None


def test_a_step_that_somebody_lets_go_is_not_asked_for_at_the_next_stop(
    bench: Bench, host: Host, run: Run
) -> None:
    stopped(bench, host, run)
    for action in ("stir", "heat_to"):
        assert choose(bench, job(run, action), "skip") == 200
    services.stop_lab(actor=bench.people["chemist"])
    hear_stop(bench, host)
    host.tell()
    assert choose(bench, job(run, "hold"), "skip") == 200
    assert job(run, "stir").halted_by == "let_go"


def test_a_run_of_which_the_rest_is_skipped_ends_only_after_each_undone_step_is_answered_for(
    bench: Bench, host: Host, run: Run
) -> None:
    stopped(bench, host, run)
    assert choose(bench, job(run, "hold"), "skip") == 200
    assert {one.passed_by for one in run.jobs.exclude(state="complete")} == {"skip"}
    assert Run.objects.get(pk=run.pk).state == "paused", "two steps are undone, and nobody said so"
    assert choose(bench, job(run, "stir"), "skip") == 200
    assert Run.objects.get(pk=run.pk).state == "paused"
    assert choose(bench, job(run, "heat_to"), "skip") == 200
    assert Run.objects.get(pk=run.pk).state == "complete"


def test_a_run_that_is_given_up_asks_for_nothing_that_a_stop_undid(
    bench: Bench, host: Host, run: Run
) -> None:
    stopped(bench, host, run)
    assert choose(bench, job(run, "hold"), "skip") == 200
    services.abort_run(run.id, actor=bench.people["chemist"], reason="the stirrer is gone")
    assert Run.objects.get(pk=run.pk).state == "aborted"


def test_a_run_whose_last_step_ends_while_the_lab_is_stopped_waits_for_an_answer(
    bench: Bench, host: Host, run: Run
) -> None:
    last = Job.objects.get(run=run, index=0)
    Job.objects.filter(run=run, index__gt=0).delete()
    next_one(host)
    row = host.begin()
    services.stop_lab(actor=bench.people["chemist"])
    hear_stop(bench, host)
    host.end(row, ActionReport(ok=True))
    host.tell()
    found = Run.objects.get(pk=run.pk)
    assert found.state == "paused", "what its last step had set was gone as it was set"
    assert [one["kind"] for one in found.pause_reasons] == ["stopped", "halted"]
    reset(bench, host)
    host.tell()
    assert choose(bench, last, "skip") == 200
    assert Run.objects.get(pk=run.pk).state == "complete"


def test_a_cancel_voids_what_else_its_device_was_set_to(bench: Bench, host: Host, run: Run) -> None:
    row = holding(host, run)
    cancel = Cancel(
        host_id=host.edge.host_id, epoch=host.edge.epoch, dseq=row.dseq, action_id=row.action_id
    )
    with host.write() as tx:
        command_acceptance.take_command(
            tx, row.signed, cancel, at=host.now(), line_of=lambda _: "line"
        )
    host.end(row, HALTED, is_halted=True)
    host.tell()
    assert data(bench)["speed_setpoint_rpm"] is None
    assert agrees(bench, host)
    assert job(run, "stir").halted_by == "edge.halted"


def test_an_action_that_is_answered_for_after_a_stop_sets_nothing_that_the_stop_took_away(
    bench: Bench, host: Host, run: Run
) -> None:
    next_one(host)
    row = host.begin()
    host.end(row, UNKNOWN)
    host.tell()
    services.stop_lab(actor=bench.people["chemist"])
    hear_stop(bench, host)
    host.tell()
    services.resolve_job(
        Attempt.objects.get(pk=row.action_id).job_id,
        actor=bench.people["admin"],
        answer="happened",
        moved_nl=None,
        note="it was warm",
    )
    reset(bench, host)
    host.tell()
    first = Job.objects.get(run=run, index=0)
    assert (first.state, first.halted_by) == ("complete", "edge.halted")
    assert not [one for one in data(bench).items() if "setpoint" in one[0] and one[1] is not None]
    assert agrees(bench, host)


@pytest.mark.parametrize("is_halted", [True, False])
def test_what_is_answered_for_without_its_host_is_undone_by_a_halt_that_the_host_had_told(
    bench: Bench, host: Host, run: Run, is_halted: bool
) -> None:
    next_one(host)
    row = host.begin()
    host.tell()
    if is_halted:
        with host.write() as tx:
            halted_setpoints.write_halt(tx, row, halted_setpoints.WITH_ACTION)
        host.tell()
    fencing.quarantine(bench.host, "host.gap", "its log has a gap")
    enrollment_services.readmit_host(
        bench.host.id, actor=bench.people["admin"], reason="I looked at every vessel"
    )
    Edge(bench).connect()
    services.resolve_job(
        Attempt.objects.get(pk=row.action_id).job_id,
        actor=bench.people["admin"],
        answer="happened",
        moved_nl=None,
        note="it was warm",
    )
    first = Job.objects.get(run=run, index=0)
    assert (first.state, first.halted_by) == ("complete", "edge.halted" if is_halted else "")
    known = [name for name, value in data(bench).items() if "setpoint" in name and value]
    assert bool(known) is not is_halted
    assert Run.objects.get(pk=run.pk).state == ("paused" if is_halted else "running")
    assert differences(bench.lab) == []
    assert differences(bench.lab) == []


def test_a_doubt_about_a_device_that_answers_again_says_how_it_was_found(
    bench: Bench, host: Host, run: Run
) -> None:
    holding(host, run)
    row = next(one for one in host.disk.rows(ActionState.STARTED))
    found = action_execution.FoundDevice(
        is_halted=False, is_owed=True, text="its device may still move: silent"
    )
    with host.write() as tx:
        action_execution.recover(tx, row, found)
    host.tell()
    assert data(bench)["speed_setpoint_rpm"] == 400.0, "nothing was halted yet"
    with host.write() as tx:
        halted_setpoints.write_late_halt(
            tx, row.device_id, "its device was halted, and stands", {"temperature_c": 58.0}
        )
    host.tell()
    doubt = job(run, "hold")
    assert doubt.state == "in_doubt"
    assert doubt.message.endswith("It answers again: its device was halted, and stands")
    assert doubt.evidence["report"]["evidence"]["temperature_c"] == 58.0
    assert data(bench)["speed_setpoint_rpm"] is None
    assert job(run, "stir").halted_by == "edge.interrupted"
    assert agrees(bench, host)


def test_a_device_that_completes_while_the_lab_is_stopped_is_not_recorded_as_set(
    bench: Bench, host: Host, run: Run
) -> None:
    next_one(host)
    row = host.begin()
    services.stop_lab(actor=bench.people["chemist"])
    hear_stop(bench, host)
    host.end(row, ActionReport(ok=True))
    host.tell()
    assert data(bench).get("temperature_setpoint_c") is None
    assert agrees(bench, host)
    assert Job.objects.get(run=run, index=0).halted_by == "edge.halted"


def test_what_a_host_has_not_begun_is_given_back_at_a_stop_and_does_not_begin_at_the_reset(
    bench: Bench, host: Host, run: Run
) -> None:
    next_one(host)
    services.stop_lab(actor=bench.people["chemist"])
    hear_stop(bench, host)
    host.take()
    reset(bench, host)
    assert not host.step()
    host.tell()
    assert states(run)[0] == "held"
    assert differences(bench.lab) == []
    services.resume_run(run.id, actor=bench.people["chemist"])
    assert (states(run)[0], differences(bench.lab)) == ("queued", [])


def test_a_halt_of_a_resource_that_the_server_knows_better_is_written_on_what_it_knows(
    bench: Bench, host: Host, run: Run
) -> None:
    row = holding(host, run)
    heater = bench.node("heater_1")
    resource_services.raise_revs([heater.id])
    services.stop_lab(actor=bench.people["chemist"])
    hear_stop(bench, host)
    host.end(row, HALTED, is_halted=True)
    host.tell()
    found = resource_selectors.rows([heater.id]).get()
    assert found.data["speed_setpoint_rpm"] is None
    assert found.rev > host.disk.resources[heater.id].view.rev - 1


def test_a_host_that_tells_of_a_halt_of_a_foreign_device_changes_nothing(
    bench: Bench, host: Host
) -> None:
    host.tell()
    before = Event.objects.count()
    host.edge.events = list(host.disk.events)
    host.edge.report("halted", None, device_id=str(bench.lab.id), code="edge.stopped")
    assert Event.objects.count() == before
    assert Ticket.objects.get().code == "host.bad_word"
