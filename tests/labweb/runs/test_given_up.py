"""Runs that are given up, and actions of which a person cannot tell either what they did."""

from __future__ import annotations

from datetime import datetime, timedelta

from labweb.common.clock import now
from labweb.crutd.api import event_rows
from labweb.crutd.models import Event, Ticket
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.records.services.ledger_rebuild import differences, rebuild
from labweb.resources.models import Resource
from labweb.runs import services
from labweb.runs.models import Job
from tests.builders import Bench, a_started_run
from tests.labweb.runs.hosts import Host, a_heating_run
from tests.labweb.runs.test_abort import abort, shown
from tests.labweb.runs.test_device_halts import UNKNOWN, agrees, data, holding, job, next_one


def test_what_nobody_can_tell_of_a_setting_is_unknown_to_host_and_server_and_their_events(
    bench: Bench,
) -> None:
    host, run = Host(bench), a_heating_run(bench)
    row = holding(host, run)
    assert data(bench)["temperature_setpoint_c"] == 60.0
    host.end(row, UNKNOWN)
    host.tell()
    services.resolve_job(
        job(run, "hold").id,
        actor=bench.people["chemist"],
        answer="discard",
        moved_nl=None,
        note="?",
    )
    host.take()
    host.tell()
    assert data(bench)["temperature_setpoint_c"] is None
    assert data(bench)["speed_setpoint_rpm"] == 400.0
    assert agrees(bench, host)
    assert not Ticket.objects.exists()
    [told] = event_rows(list(Event.objects.filter(state="rolled_back")))
    assert told.summary.endswith(": temperature_setpoint_c unknown")


def test_what_nobody_can_tell_of_a_transfer_leaves_the_same_revisions_in_events_and_vessels(
    bench: Bench,
) -> None:
    host, run = Host(bench), a_started_run(bench)
    while True:
        next_one(host)
        row = host.begin()
        if row.do.action in {"aspirate", "dispense"}:
            break
        host.end(row, ActionReport(ok=True))
        host.tell()
    host.end(row, UNKNOWN)
    host.tell()
    doubtful = Job.objects.get(run=run, state="in_doubt")
    services.resolve_job(
        doubtful.id, actor=bench.people["chemist"], answer="discard", moved_nl=None, note="?"
    )
    host.take()
    host.tell()
    assert differences(bench.lab) == []
    before = {one.pk: one.rev for one in Resource.objects.all()}
    rebuild(bench.lab)
    assert {one.pk: one.rev for one in Resource.objects.all()} == before


def test_an_aborted_run_says_who_gave_it_up_when_and_why(bench: Bench) -> None:
    run = a_heating_run(bench)
    assert shown(bench, run)["given_up"] is None
    before = now()
    abort(bench, run)
    found = shown(bench, run)["given_up"]
    assert (found["by"], found["reason"]) == (bench.people["chemist"].printed_name, "it smells")
    assert before <= datetime.fromisoformat(found["at"]) + timedelta(seconds=1)
