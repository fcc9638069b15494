"""A run over a backbone of two pumps: each pass is sent as two jobs that begin together."""

from __future__ import annotations

import json
from typing import Any
from uuid import uuid4

import pytest

from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.resources.models import Connection
from labweb.runs import services
from labweb.runs.models import Attempt, Job, Outbox, Run
from labweb.workflows.models import WorkflowVersion
from tests.builders import MOVE_WATER, Bench
from tests.labweb.runs.hosts import Host, live_locks, states
from tests.labweb.web import call, signed_in

ALONE = {"on_disconnect": "continue", "max_offline_s": 600}


def a_run(bench: Bench, **document: object) -> Run:
    """Move 3 mL of acid, which pump 1 reaches, to the dye, which pump 2 reaches."""
    Connection.objects.create(
        id=uuid4(),
        lab=bench.lab,
        key="backbone",
        source=bench.node("valve_1"),
        source_port="7",
        target=bench.node("valve_2"),
        target_port="7",
        medium="liquid",
        dead_volume_nl=100_000,
    )
    known = bench.version(MOVE_WATER)
    params = {"source": str(bench.node("acid").id), "target": str(bench.node("dye").id)}
    step = {"id": "t", "kind": "transfer", "params": {**params, "volume": "3 mL"}}
    whole = {
        "schema": "labweb.workflow/1",
        "name": "Over the backbone",
        "steps": [{**step, "position": {"x": 0, "y": 0}}],
        "edges": [],
        **document,
    }
    made = WorkflowVersion.objects.create(
        id=uuid4(),
        workflow=known.workflow,
        number=99,
        document=whole,
        author=known.author,
        at=known.at,
        digest=known.digest,
    )
    return services.start_run(made, actor=bench.people["chemist"])


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


def pair(run: Run) -> tuple[Job, Job]:
    giver = Job.objects.filter(run=run, meets__isnull=False).order_by("index")[0]
    assert giver.meets is not None
    return giver, Job.objects.get(run=run, index=giver.meets)


def work(run: Run, host: Host) -> None:
    """Let the host do what comes before the pass."""
    giver, _ = pair(run)
    while services.dispatch_ready():
        host.take()
        if Job.objects.get(pk=giver.pk).state != "queued":
            return
        while host.step():
            pass
        host.tell()


def recover(bench: Bench, job: Job, **choice: object) -> tuple[int, dict[str, Any]]:
    path = f"/api/v1/jobs/{job.id}/recover"
    answer = call(signed_in(bench.people["chemist"]), "POST", path, {"note": "seen", **choice})
    return answer.status_code, json.loads(answer.content)


def choices(bench: Bench, job: Job) -> dict[str, str | None]:
    answer = signed_in(bench.people["chemist"]).get(f"/api/v1/runs/{job.run_id}").json()
    card = next(one for one in answer["jobs"] if one["id"] == str(job.id))["recovery"]
    return {one["name"]: one["why_not"] for one in card["choices"]}


def test_two_jobs_that_meet_go_in_one_command_though_the_run_declares_nothing(
    bench: Bench, host: Host
) -> None:
    run = a_run(bench)
    work(run, host)
    giver, receiver = pair(run)
    assert (giver.state, receiver.state) == ("dispatched", "dispatched")
    assert (giver.meets, receiver.meets) == (receiver.index, giver.index)
    sent = Outbox.objects.get(kind="batch")
    parts = [member["batch"] for member in sent.body["members"]]
    ids = [str(Attempt.objects.get(job=one).id) for one in (giver, receiver)]
    assert [part["meets"] for part in parts] == ids[::-1]
    assert states(run).count("dispatched") == 2


@pytest.mark.parametrize("document", [{}, {"execution": ALONE}])
def test_a_run_over_a_backbone_ends_with_the_liquid_where_it_belongs(
    bench: Bench, host: Host, document: dict[str, object]
) -> None:
    run = a_run(bench, **document)
    while services.dispatch_ready():
        host.take()
        while host.step():
            host.mono_s += 1.0
        host.tell()
    assert set(states(run)) == {"complete"}
    assert live_locks() == 0
    client = signed_in(bench.people["chemist"])
    held = {
        key: client.get(f"/api/v1/resources/{bench.node(key).id}").json()["volume_nl"]
        for key in ("pump_1", "pump_2")
    }
    assert held == {"pump_1": 0, "pump_2": 0}


def test_a_second_try_is_not_offered_while_the_other_one_is_complete(
    bench: Bench, host: Host
) -> None:
    run = a_run(bench)
    work(run, host)
    giver, receiver = pair(run)
    host.step(report=ActionReport(ok=False, code="device.rejected", message="no"))
    host.tell()
    assert Job.objects.get(pk=receiver.pk).state == "complete"
    why_not = choices(bench, giver)["retry"]
    wanted = f"it moves together with {receiver.sentence!r}: the job is complete, not undone"
    assert why_not == wanted


def test_a_second_try_sends_both(bench: Bench, host: Host) -> None:
    run = a_run(bench)
    work(run, host)
    giver, receiver = pair(run)
    for job in (giver, receiver):
        Job.objects.filter(pk=job.pk).update(state="rejected")
    status, _ = recover(bench, receiver, choice="retry")
    assert status == 200
    assert [Job.objects.get(pk=one.pk).state for one in (giver, receiver)] == ["queued", "queued"]


def test_what_is_skipped_takes_the_other_one_along(bench: Bench, host: Host) -> None:
    run = a_run(bench)
    work(run, host)
    giver, receiver = pair(run)
    Job.objects.filter(pk=receiver.pk).update(state="rejected")
    Job.objects.filter(pk=giver.pk).update(state="held")
    status, _ = recover(bench, receiver, choice="skip")
    assert status == 200
    giver.refresh_from_db()
    assert (giver.state, giver.passed_by) == ("stopped", "skip")


def test_what_is_done_by_hand_takes_the_other_one_along(bench: Bench, host: Host) -> None:
    run = a_run(bench)
    work(run, host)
    giver, receiver = pair(run)
    host.step(before={})  # nothing can be read: the giver is rejected, and its receiver given back
    host.step()
    host.tell()
    giver.refresh_from_db()
    receiver.refresh_from_db()
    assert (giver.state, receiver.state, receiver.code) == ("rejected", "held", "edge.partner")
    assert recover(bench, giver, choice="done_by_hand", moved_ul=3000)[0] == 200
    receiver.refresh_from_db()
    assert (receiver.state, receiver.passed_by) == ("stopped", "hand")


def test_what_is_poured_by_hand_is_written_down_at_the_giver(bench: Bench, host: Host) -> None:
    run = a_run(bench)
    work(run, host)
    giver, receiver = pair(run)
    Job.objects.filter(pk=receiver.pk).update(state="rejected")
    Job.objects.filter(pk=giver.pk).update(state="held")
    why_not = choices(bench, receiver)["done_by_hand"]
    assert why_not == f"what is poured by hand is written down at {giver.sentence!r}"
