"""A device that is not read any more while something of a run stands on it: a person is told."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from django.db import connection
from django.test.utils import CaptureQueriesContext

from labweb.common import feed
from labweb.common.clock import now
from labweb.domain.runs.halts import halted_setpoints
from labweb.domain.runs.host_journal.action_states import ActionReport, ActionState
from labweb.enrollment.models import EdgeHost
from labweb.fleet.management.commands.dispatcher import Watch
from labweb.runs import services
from labweb.runs.models import Job, Run
from labweb.runs.selectors import lab_summary
from labweb.telemetry.models import Sample
from labweb.telemetry.services import take_in
from tests.builders import Bench
from tests.labweb.runs.hosts import Host, a_heating_run
from tests.labweb.web import signed_in


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


@pytest.fixture
def run(bench: Bench, host: Host) -> Run:
    """Heat and stir, an hour ago; the hold has not begun, so nothing acts."""
    made = a_heating_run(bench)
    while True:
        services.dispatch_ready()
        host.take()
        if all(row.do.action == "hold" for row in host.disk.rows(ActionState.ACCEPTED)):
            break
        host.end(host.begin(), ActionReport(ok=True))
        host.tell()
    Job.objects.filter(run=made, state="complete").update(ended_at=now() - timedelta(hours=1))
    return made


def read(bench: Bench, ago_s: float, status: str = "temperature_setpoint_c") -> datetime:
    """Have the heater tell a status so long ago."""
    device, at_s = bench.device("heater_1").id, now().timestamp() - ago_s
    take_in({device}, [(str(device), status, at_s, 60.0)])
    return datetime.fromtimestamp(at_s, UTC)


def needs(bench: Bench) -> list[dict[str, Any]]:
    told = signed_in(bench.people["chemist"]).get("/api/v1/home").json()["needs_you"]
    return [one for one in told if one["kind"] == "silent"]


def cards(bench: Bench, run: Run) -> list[dict[str, Any]]:
    page = signed_in(bench.people["chemist"]).get(f"/api/v1/runs/{run.id}").json()
    found: list[dict[str, Any]] = page["silent"]
    return found


def test_a_silent_device_is_told_at_home_and_on_the_page_and_counted(
    bench: Bench, run: Run
) -> None:
    read(bench, 5.0)
    before = lab_summary(bench.lab).counts.needs_you
    assert (needs(bench), cards(bench, run)) == ([], [])
    Sample.objects.all().delete()
    at = read(bench, 31.0)
    heater = bench.device("heater_1")
    assert lab_summary(bench.lab).counts.needs_you == before + 1
    [need] = needs(bench)
    assert need["title"].startswith(heater.name)
    assert (need["run_id"], need["url"]) == (str(run.id), f"/runs/{run.id}")
    assert datetime.fromisoformat(need["since_at"]) == at
    [card] = cards(bench, run)
    assert card["device"] == {"id": str(heater.id), "name": heater.name}
    heat, stir = (Job.objects.get(run=run, action=one) for one in ("heat_to", "stir"))
    assert set(card["sentences"]) == {heat.sentence, stir.sentence}
    assert all(one.sentence in need["detail"] for one in (heat, stir))
    run.refresh_from_db()
    assert (run.state, run.pause_reasons) == ("running", []), "it is not held for that"
    read(bench, 1.0)
    assert (needs(bench), cards(bench, run)) == ([], []), "it answers again"
    assert lab_summary(bench.lab).counts.needs_you == before


def test_a_status_that_shows_nothing_of_what_was_set_is_no_word_about_it(
    bench: Bench, run: Run
) -> None:
    read(bench, 40.0)
    read(bench, 1.0, status="temperature_c")
    assert len(needs(bench)) == 1


def test_what_was_set_just_now_need_not_have_been_read_yet(bench: Bench, run: Run) -> None:
    read(bench, 40.0)
    Job.objects.filter(run=run, state="complete").update(ended_at=now() - timedelta(seconds=20))
    assert needs(bench) == []


def test_a_faster_clock_of_the_lab_shortens_the_wait(bench: Bench, run: Run) -> None:
    read(bench, 4.0)
    assert needs(bench) == []
    EdgeHost.objects.update(pace=20.0)
    assert len(needs(bench)) == 1, "80 s of lab time"


def test_an_action_that_acts_there_reads_it_back_itself(bench: Bench, host: Host, run: Run) -> None:
    read(bench, 40.0)
    assert len(needs(bench)) == 1
    assert host.begin().do.action == "hold"
    host.tell()
    assert needs(bench) == []


def test_nothing_is_told_of_what_a_halt_has_taken_away(bench: Bench, host: Host, run: Run) -> None:
    read(bench, 40.0)
    assert len(needs(bench)) == 1
    with host.write() as tx:
        halted_setpoints.write_halts(tx, halted_setpoints.STOPPED)
    host.tell()
    assert needs(bench) == []


def test_the_plan_of_a_run_is_not_read_once_for_each_of_its_jobs(bench: Bench, run: Run) -> None:
    """The plan of hundreds of jobs has megabytes: a page took half a minute."""
    read(bench, 40.0)
    chemist = signed_in(bench.people["chemist"])
    for path in ("home", f"runs/{run.id}", "devices", "hosts"):
        with CaptureQueriesContext(connection) as asked:
            assert chemist.get(f"/api/v1/{path}").status_code == 200
        sent = [one["sql"].partition(" FROM ") for one in asked]
        of_jobs = [what for what, _, rest in sent if rest.startswith('"runs_job"')]
        assert [what for what in of_jobs if '"runs_run"."plan"' in what] == [], path


def test_pages_hear_once_that_a_device_fell_silent_and_once_that_it_is_read(
    bench: Bench, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[str] = []
    monkeypatch.setattr(
        feed,
        "publish_all",
        lambda told: heard.extend(topic for topic, _ in told if topic.startswith("run")),
    )
    watch = Watch()
    [duty] = [one for one in watch.duties if "silent" in getattr(one, "__name__", "")]
    read(bench, 40.0)
    duty()
    duty()
    assert heard == [f"run:{run.id}", "runs"]
    read(bench, 1.0)
    duty()
    assert heard == [f"run:{run.id}", "runs"] * 2
