"""A job that asks for a role goes to the first device that is free when its turn comes."""

from __future__ import annotations

from datetime import timedelta
from typing import Any
from uuid import UUID

import pytest

from labweb.common.clock import new_id, now
from labweb.domain.errors import LockedError
from labweb.enrollment.models import Device
from labweb.runs import services
from labweb.runs.models import Job, Run
from labweb.telemetry.models import Sample
from labweb.workflows import services as workflow_services
from tests.builders import Bench, a_started_run, an_edge, dispatched
from tests.labweb.web import read, signed_in


def a_valve_run(bench: Bench, port: int = 2, *, under: str = "bench_1") -> Run:
    """Start a run whose only step asks for any valve under a place."""
    params = {
        "role": "valve",
        "under": str(bench.node(under).id),
        "action": "select_port",
        "args": {"port_index": port},
    }
    step = {"id": "v", "kind": "role_action", "params": params, "position": {"x": 0, "y": 0}}
    document: dict[str, Any] = {
        "schema": "labweb.workflow/1",
        "name": "Turn a valve",
        "steps": [step],
        "edges": [],
    }
    chemist = bench.people["chemist"]
    workflow = workflow_services.create_workflow(
        bench.lab, name=f"Turn a valve {new_id()}", document=document, actor=chemist
    )
    version = workflow_services.save_version(workflow.id, note="", actor=chemist)
    return services.start_run(version, actor=chemist)


def job_of(run: Run) -> Job:
    return Job.objects.select_related("device").get(run=run)


def test_it_goes_to_the_first_device_and_says_of_how_many(bench: Bench) -> None:
    run = a_valve_run(bench)
    assert len(job_of(run).choices) == 2
    an_edge(bench)
    attempt = dispatched(run)
    job = job_of(run)
    assert (job.state, job.device.key) == ("dispatched", "pump_1")
    assert job.chosen == "Pump 1, the first of 2 that was free"
    assert attempt.transaction.operation["resource_id"] == job.operation["resource_id"]


def test_it_goes_past_a_device_that_another_run_uses_and_says_why(bench: Bench) -> None:
    other = a_started_run(bench)
    edge = an_edge(bench)
    first = dispatched(other)
    assert first.job.device.key == "pump_1"
    run = a_valve_run(bench)
    attempt = dispatched(run)
    job = job_of(run)
    assert job.device.key == "pump_2"
    assert job.chosen.startswith("Pump 2, the first of 2 that was free; Pump 1: ")
    assert set(job.locks) == set(job.choices[1]["locks"])
    assert UUID(job.operation["resource_id"]) in {UUID(node) for node in job.device.nodes.values()}
    edge.complete(attempt)
    assert Run.objects.get(pk=run.pk).state == "complete"


def test_it_waits_while_all_are_busy_and_goes_when_one_is_free(bench: Bench) -> None:
    edge = an_edge(bench)
    runs = [a_valve_run(bench) for _ in range(3)]
    attempts = [dispatched(run) for run in runs[:2]]
    assert {attempt.job.device.key for attempt in attempts} == {"pump_1", "pump_2"}
    waiting = job_of(runs[2])
    assert waiting.state == "queued"
    assert waiting.chosen.startswith("waits for one that is free: Pump 1: ")
    assert "; Pump 2: " in waiting.chosen
    edge.complete(attempts[1])
    dispatched(runs[2])
    assert job_of(runs[2]).device_id == attempts[1].job.device_id


def test_it_goes_past_a_device_that_was_suspended_since_it_was_planned(bench: Bench) -> None:
    run = a_valve_run(bench)
    Device.objects.filter(key="pump_1").update(state="suspended")
    an_edge(bench)
    dispatched(run)
    job = job_of(run)
    assert (job.device.key, "Pump 1: it is suspended" in job.chosen) == ("pump_2", True)


def test_it_goes_past_a_device_that_fell_silent(bench: Bench) -> None:
    run = a_valve_run(bench)
    an_edge(bench)
    device = Device.objects.get(key="pump_1")
    at = now().timestamp() - 600
    Sample.objects.create(device_id=device.id, status="volume_ul", at=at, value=0.0)
    dispatched(run)
    assert "Pump 1: it has told nothing for minutes" in job_of(run).chosen


def test_it_goes_nowhere_while_its_host_is_away(bench: Bench) -> None:
    run = a_valve_run(bench)
    assert services.dispatch_ready() == 0
    assert job_of(run).state == "queued"


def test_a_second_try_may_go_to_another_device(bench: Bench) -> None:
    edge = an_edge(bench)
    run = a_valve_run(bench)
    attempt = dispatched(run)
    edge.report("rejected", attempt.id, code="device.rejected", message="no")
    Device.objects.filter(key="pump_1").update(state="suspended")
    services.recover_job(
        job_of(run).id, choice="retry", actor=bench.people["chemist"], note="try the other"
    )
    services.resume_run(run.id, actor=bench.people["chemist"])
    dispatched(run)
    assert job_of(run).device.key == "pump_2"


def test_a_device_that_is_reserved_by_another_keeps_no_such_run_from_its_start(
    bench: Bench,
) -> None:
    services.reserve(
        [bench.node("pump_1").id],
        actor=bench.people["admin"],
        lasts=timedelta(hours=1),
        reason="cleaning",
    )
    with pytest.raises(LockedError):
        a_started_run(bench)
    run = a_valve_run(bench)
    an_edge(bench)
    dispatched(run)
    job = job_of(run)
    assert (job.device.key, "Pump 1: " in job.chosen) == ("pump_2", True)


def test_the_page_of_the_run_says_which_device_and_why(bench: Bench) -> None:
    run = a_valve_run(bench)
    an_edge(bench)
    dispatched(run)
    (job,) = read(signed_in(bench.people["chemist"]), f"/api/v1/runs/{run.id}")["jobs"]
    assert (job["choices_count"], job["device"]["name"]) == (2, "Pump 1")
    assert job["chosen"] == "Pump 1, the first of 2 that was free"
