"""What is started was carried out on paper first: a fault of the planner starts nothing."""

from __future__ import annotations

import json
from typing import Any

import pytest
from django.test import Client
from msgspec.structs import replace

from labweb.domain.workflows import compile_workflow as compiling
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.plan import Plan
from labweb.domain.workflows.workflow_file import Workflow
from labweb.runs.models import Job, Run
from labweb.runs.services.planning import preview
from tests.builders import HEAT, MOVE_WATER, Bench, a_started_run
from tests.labweb.web import call, signed_in

CHECK = "/api/v1/workflows/check"


def checked(client: Client, document: dict[str, Any]) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(call(client, "POST", CHECK, {"document": document}).content)
    return told


@pytest.fixture
def port_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the planner turn the first valve of each plan one port too far."""
    sound = compiling.compile_workflow

    def compile_workflow(workflow: Workflow, lab: PlannerView) -> Plan:
        plan = sound(workflow, lab)
        jobs = list(plan.jobs)
        first = next(job.index for job in jobs if job.action == "select_port")
        port = jobs[first].args["port_index"]
        jobs[first] = replace(jobs[first], args={"port_index": port % 4 + 1})
        return replace(plan, jobs=tuple(jobs))

    monkeypatch.setattr(preview, "compile_workflow", compile_workflow)


def test_a_check_says_which_steps_are_proved(bench: Bench) -> None:
    client = signed_in(bench.people["chemist"])
    document = bench.version(MOVE_WATER).document
    answer = checked(client, document)
    assert answer["findings"] == []
    moves = [step["id"] for step in document["steps"] if step["kind"] == "transfer"]
    assert answer["plan"]["proved"] == {"steps": moves, "beyond": []}
    heat = checked(client, bench.version(HEAT).document)
    assert heat["plan"]["proved"] == {"steps": [], "beyond": []}


@pytest.mark.usefixtures("port_off")
def test_a_plan_that_would_do_something_else_is_no_plan_and_starts_nothing(bench: Bench) -> None:
    client = signed_in(bench.people["chemist"])
    version = bench.version(MOVE_WATER)
    told = checked(client, version.document)
    assert told["plan"] is None
    answer = call(client, "POST", "/api/v1/runs", {"version_id": str(version.id)})
    refused = json.loads(answer.content)
    assert refused["code"] == "plan.not_proved"
    assert {one["code"] for one in refused["findings"]} == {"plan.not_proved"}
    assert "the plan would do something else" in refused["findings"][0]["message"]
    assert not Run.objects.exists()
    assert not Job.objects.exists()


def test_a_run_keeps_what_was_proved_of_its_plan(bench: Bench) -> None:
    client = signed_in(bench.people["chemist"])
    run = a_started_run(bench)
    moves = [one["id"] for one in run.version.document["steps"] if one["kind"] == "transfer"]
    told = client.get(f"/api/v1/runs/{run.id}").json()
    assert told["plan"]["proved"] == {"steps": moves, "beyond": []}
    Run.objects.filter(pk=run.pk).update(plan={k: v for k, v in run.plan.items() if k != "proved"})
    old = client.get(f"/api/v1/runs/{run.id}").json()
    assert old["plan"]["proved"] is None, "a run of before says nothing of a proof"
