"""Estimates of a run follow the clock of the instruments, and are told by the clock on the wall."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

import pytest

from labweb.common.clock import now
from labweb.domain.errors import EnrollmentError
from labweb.enrollment import services as enrollment_services
from labweb.resources.models import Lab
from labweb.runs.models import Job, Run
from tests.builders import Bench, Edge
from tests.labweb.runs.hosts import a_heating_run
from tests.labweb.web import signed_in

PACE = 20.0


def shown(bench: Bench, run: Run) -> dict[str, Any]:
    found: dict[str, Any] = signed_in(bench.people["chemist"]).get(f"/api/v1/runs/{run.id}").json()
    return found


def at_pace(bench: Bench, pace: float) -> None:
    edge = Edge(bench)
    enrollment_services.open_session(edge.hello("nonce", pace=pace), "nonce")


def test_a_run_tells_the_time_that_it_takes_by_the_clock_on_the_wall(bench: Bench) -> None:
    run = a_heating_run(bench)
    planned = shown(bench, run)
    at_pace(bench, PACE)
    found = shown(bench, run)
    for name in ("estimate_s", "left_s"):
        assert planned[name] > 60
        assert found[name] == pytest.approx(planned[name] / PACE)
    for part in ("jobs", "steps"):
        before, after = planned["plan"][part], found["plan"][part]
        assert [one["estimate_s"] for one in after] == pytest.approx(
            [one["estimate_s"] / PACE for one in before]
        )
    assert found["plan"]["estimate_s"] == pytest.approx(planned["plan"]["estimate_s"] / PACE)
    assert [job["estimate_s"] for job in found["jobs"]] == pytest.approx(
        [job["estimate_s"] / PACE for job in planned["jobs"]]
    )


def test_what_is_left_of_an_action_is_less_the_real_time_that_it_has_run(bench: Bench) -> None:
    run = a_heating_run(bench)
    at_pace(bench, PACE)
    whole_s = shown(bench, run)["left_s"]
    job = Job.objects.filter(run=run).order_by("-estimate_s")[0]
    Job.objects.filter(pk=job.pk).update(started_at=now() - timedelta(seconds=3))
    left_s = shown(bench, run)["left_s"]
    job.refresh_from_db()
    assert job.started_at is not None
    since_s = (now() - job.started_at).total_seconds()
    assert whole_s - since_s <= left_s <= whole_s - 3


def test_the_lab_shows_the_pace_that_its_host_has_told(bench: Bench) -> None:
    client = signed_in(bench.people["chemist"])
    assert client.get("/api/v1/lab").json()["speed"] == 1.0
    at_pace(bench, PACE)
    assert client.get("/api/v1/lab").json()["speed"] == PACE


def test_a_live_lab_opens_no_session_for_a_host_that_runs_faster(bench: Bench) -> None:
    Lab.objects.filter(pk=bench.lab.pk).update(mode="live")
    with pytest.raises(EnrollmentError) as refusal:
        at_pace(bench, PACE)
    assert refusal.value.code == "host.pace"
    at_pace(bench, 1.0)
