"""Runs keep what they use from first to last use: nobody else walks through them.

Water ┬─▶ Pump 1 ─┬─▶ Reactor 1 ─▶ …      Acid ─▶ Pump 1     Dye ─▶ Pump 2
      └─▶ Pump 2 ─┴─▶ Flask 1, Flask 2
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any
from uuid import uuid4

import pytest

from labweb.common.clock import new_id
from labweb.crutd.models import ResourceLock, RunHold
from labweb.runs import services
from labweb.runs.models import Attempt, Job, Run
from labweb.workflows import services as workflow_services
from tests.builders import Bench, Edge, an_edge
from tests.labweb.crutd.hand import node, post, pour
from tests.labweb.crutd.test_by_hand_stock import archive
from tests.labweb.web import read, signed_in

pytestmark = pytest.mark.django_db


def step(name: str, kind: str, **params: Any) -> dict[str, Any]:  # noqa: ANN401
    return {"id": name, "kind": kind, "params": params, "position": {"x": 0, "y": 0}}


def move(name: str, source: str, target: str, volume: str = "5 mL") -> dict[str, Any]:
    return step(name, "transfer", source=f"@{source}", target=f"@{target}", volume=volume)


def named(bench: Bench, params: dict[str, Any]) -> dict[str, Any]:
    """Put the id of a resource where its key stands."""
    return {
        name: node(bench, value[1:]) if value.startswith("@") else value
        for name, value in params.items()
    }


def a_run(bench: Bench, *steps: dict[str, Any], by: str = "chemist") -> Run:
    """Start a run of these steps, one after the other."""
    edges = [
        {
            "id": f"e{number}",
            "source": one["id"],
            "source_port": "done",
            "target": other["id"],
            "target_port": "start",
        }
        for number, (one, other) in enumerate(pairwise(steps))
    ]
    document = {
        "schema": "labweb.workflow/1",
        "name": "Steps",
        "steps": [{**one, "params": named(bench, one["params"])} for one in steps],
        "edges": edges,
    }
    actor = bench.people[by]
    workflow = workflow_services.create_workflow(
        bench.lab, name=f"Steps {new_id()}", document=document, actor=actor
    )
    version = workflow_services.save_version(workflow.id, note="", actor=actor)
    return services.start_run(version, actor=actor)


def sent(run: Run) -> list[str]:
    """Return what of a run is at its host."""
    return list(Job.objects.filter(run=run, state="dispatched").values_list("sentence", flat=True))


def complete_next(edge: Edge, run: Run) -> None:
    """Carry out what was sent of a run, and let the scheduler have its turn."""
    services.dispatch_ready()
    for attempt in Attempt.objects.filter(job__run=run, job__state="dispatched"):
        edge.complete(attempt)
    services.dispatch_ready()


def end_step(edge: Edge, run: Run, name: str) -> None:
    while Job.objects.filter(run=run, step_id=name).exclude(state="complete").exists():
        complete_next(edge, run)


def end(edge: Edge, *runs: Run) -> None:
    for _ in range(60):
        for run in runs:
            complete_next(edge, run)
    assert {Run.objects.get(pk=run.pk).state for run in runs} == {"complete"}


def waits(run: Run) -> dict[str, Any]:
    found = Run.objects.get(pk=run.pk).waits
    assert found is not None
    return dict(found)


def held_by(run: Run) -> set[str]:
    rows = RunHold.objects.filter(run_id=run.pk, released_at=None)
    return set(rows.values_list("resource__key", flat=True))


def test_no_other_run_pours_into_a_reactor_between_two_steps_of_a_run(bench: Bench) -> None:
    edge = an_edge(bench)
    first = a_run(
        bench,
        move("a", "water", "reactor_1"),
        step("w", "wait", duration="10 s"),
        move("b", "reactor_1", "flask_1", "2 mL"),
    )
    end_step(edge, first, "a")
    second = a_run(bench, move("a", "acid", "reactor_1"))
    services.dispatch_ready()
    assert not sent(second)
    told = waits(second)
    assert told["number"] == first.number
    assert told["text"] == (
        f"waits for run #{first.number}, which holds Reactor 1 until its step 3"
    )
    end(edge, first)
    end(edge, second)
    assert Run.objects.get(pk=second.pk).waits is None


def test_a_vessel_is_held_from_the_beginning_though_it_is_used_last(bench: Bench) -> None:
    """What the plan was proved on must not change before its turn comes."""
    edge = an_edge(bench)
    first = a_run(bench, move("a", "water", "flask_1"), move("b", "water", "reactor_1"))
    services.dispatch_ready()
    assert {"flask_1", "reactor_1"} <= held_by(first)
    second = a_run(bench, move("a", "dye", "reactor_1"))
    services.dispatch_ready()
    assert waits(second)["resource"] == "Reactor 1"
    end(edge, first, second)


def test_what_no_step_that_is_left_needs_is_released(bench: Bench) -> None:
    edge = an_edge(bench)
    first = a_run(
        bench,
        move("a", "water", "flask_2"),
        move("b", "water", "reactor_1"),
        move("c", "water", "reactor_1"),
    )
    end_step(edge, first, "a")
    assert "flask_2" not in held_by(first)
    assert "reactor_1" in held_by(first)
    end(edge, first)
    assert not held_by(first)


def test_runs_with_the_same_vessels_in_opposite_order_both_end(bench: Bench) -> None:
    edge = an_edge(bench)
    first = a_run(bench, move("a", "water", "reactor_1"), move("b", "water", "flask_1"))
    second = a_run(bench, move("a", "dye", "flask_1"), move("b", "dye", "reactor_1"))
    end(edge, first, second)


def test_runs_that_draw_from_one_bottle_and_pour_into_one_waste_go_side_by_side(
    bench: Bench,
) -> None:
    edge = an_edge(bench)
    first = a_run(
        bench,
        move("a", "water", "reactor_1"),
        step("w", "wait", duration="10 s"),
        move("b", "water", "reactor_1"),
    )
    end_step(edge, first, "a")
    second = a_run(bench, move("a", "water", "flask_2"))
    end(edge, second)
    assert Run.objects.get(pk=first.pk).state == "running"
    end(edge, first)


def test_a_heater_that_stays_on_is_held_until_it_is_off(bench: Bench) -> None:
    edge = an_edge(bench)
    first = a_run(
        bench,
        step("s", "start_stir", vessel="@reactor_1", stir_speed="300 rpm"),
        step("w", "wait", duration="10 s"),
        step("e", "stop_stir", vessel="@reactor_1"),
        step("x", "wait", duration="10 s"),
    )
    for request in bench.lab.approvals.filter(run_id=first.id):
        services.decide_request(
            request.id, actor=bench.people["approver"], is_approved=True, comment=""
        )
    end_step(edge, first, "s")
    assert "heater_1" in held_by(first)
    end_step(edge, first, "e")
    assert "heater_1" not in held_by(first)


def test_a_pump_is_held_for_a_step_alone(bench: Bench) -> None:
    edge = an_edge(bench)
    first = a_run(
        bench,
        move("a", "water", "reactor_1"),
        step("w", "wait", duration="10 s"),
        move("b", "water", "reactor_1"),
    )
    end_step(edge, first, "a")
    assert "pump_1" not in held_by(first)
    assert "valve_1" not in held_by(first)


def test_an_aborted_run_releases_all_and_a_paused_one_nothing(bench: Bench) -> None:
    edge = an_edge(bench)
    first = a_run(
        bench,
        move("a", "water", "reactor_1"),
        step("w", "wait", duration="10 s"),
        move("b", "water", "reactor_1"),
    )
    end_step(edge, first, "a")
    for attempt in Attempt.objects.filter(job__run=first, job__state="dispatched"):
        edge.complete(attempt)
    services.pause_run(first.pk, actor=bench.people["chemist"])
    second = a_run(bench, move("a", "acid", "reactor_1"))
    services.dispatch_ready()
    assert "reactor_1" in held_by(first)
    assert waits(second)["number"] == first.number
    services.abort_run(first.pk, actor=bench.people["chemist"], reason="enough")
    assert not held_by(first)
    services.dispatch_ready()
    assert sent(second)


def test_a_run_in_doubt_keeps_what_it_holds(bench: Bench) -> None:
    edge = an_edge(bench)
    first = a_run(bench, move("a", "water", "reactor_1"), move("b", "water", "flask_2"))
    end_step(edge, first, "a")
    edge.lose(Attempt.objects.get(job__run=first, job__state="dispatched"))
    assert "flask_2" in held_by(first)


def test_the_first_who_waits_for_a_vessel_gets_it_first(bench: Bench) -> None:
    edge = an_edge(bench)
    first = a_run(bench, move("a", "water", "reactor_1"), move("b", "water", "reactor_1"))
    end_step(edge, first, "a")
    second = a_run(bench, move("a", "dye", "reactor_1"), move("b", "dye", "flask_1"))
    services.dispatch_ready()
    assert waits(second)["number"] == first.number
    third = a_run(bench, move("a", "dye", "flask_1"))
    services.dispatch_ready()
    assert waits(third)["text"] == f"waits for run #{second.number}, which asked for Flask 1 before"
    end(edge, first, second, third)


@pytest.mark.parametrize("role", ["approver", "admin"])
def test_another_person_does_nothing_by_hand_to_what_a_run_holds(bench: Bench, role: str) -> None:
    edge = an_edge(bench)
    run = a_run(
        bench,
        move("a", "water", "reactor_1"),
        step("w", "wait", duration="10 s"),
        move("b", "water", "reactor_1"),
    )
    end_step(edge, run, "a")
    for operation in (
        archive(bench, "reactor_1"),
        pour(bench, "acid", "reactor_1", 1_000_000),
        pour(bench, "reactor_1", "flask_2", 1_000_000),
        {"op": "dispose", "resource_id": node(bench, "reactor_1")},
        archive(bench, "water"),
    ):
        status, told = post(bench, operation, role=role)
        assert (status, told["code"]) == (423, "crutd.held_by_run"), told
        assert f"run #{run.number}" in told["message"]
        assert "until its step 3" in told["message"]
        _, looked = post(bench, operation, role=role, at="/check")
        assert "crutd.held_by_run" in [one["code"] for one in looked["findings"]]
    assert post(bench, pour(bench, "water", "flask_2", 1_000_000), role=role)[0] == 201


def test_a_hold_on_something_in_a_place_is_told_in_a_plain_sentence(bench: Bench) -> None:
    edge = an_edge(bench)
    run = a_run(bench, move("a", "water", "reactor_1"), move("b", "water", "reactor_1"))
    end_step(edge, run, "a")
    _, looked = post(bench, archive(bench, "heater_1"), role="admin", at="/check")
    told = [one["message"] for one in looked["findings"] if one["code"] == "crutd.held_by_run"]
    heater, who = bench.node("heater_1").name, bench.people["chemist"].printed_name
    assert told == [
        f"run #{run.number} of {who} holds something that stands in {heater} until its step 2 has "
        f"ended: wait for that step, or ask {who} to abort the run"
    ]


def test_nobody_archives_what_a_run_holds_and_its_operator_may_pour(bench: Bench) -> None:
    edge = an_edge(bench)
    run = a_run(bench, move("a", "water", "reactor_1"), move("b", "water", "reactor_1"))
    end_step(edge, run, "a")
    for attempt in Attempt.objects.filter(job__run=run, job__state="dispatched"):
        edge.complete(attempt)
    services.pause_run(run.pk, actor=bench.people["chemist"])
    status, told = post(bench, archive(bench, "reactor_1"))
    assert (status, told["code"]) == (423, "crutd.held_by_run")
    assert post(bench, pour(bench, "reactor_1", "flask_2", 1_000_000))[0] == 201


def test_a_thing_is_created_and_carried_beside_a_transfer_that_runs(bench: Bench) -> None:
    """Nothing of it is used: root, bench and Archive only have something put into them."""
    bench.unplug("flask_2")
    edge = an_edge(bench)
    run = a_run(bench, move("a", "water", "reactor_1"))
    services.dispatch_ready()
    edge.begin(Attempt.objects.get(job__run=run, job__state="dispatched"))
    assert ResourceLock.objects.filter(released_at=None).exists()
    for place in ("bench_1", "lab"):
        create = {
            "op": "create",
            "resource_id": str(uuid4()),
            "parent_id": node(bench, place),
            "key": f"vial_{place}",
            "name": f"Vial on {place}",
            "kind": "vial",
            "config": {"capacity_ul": 1000},
        }
        assert post(bench, create, role="admin")[0] == 201
    carry = {
        "op": "transfer_resource",
        "resource_id": node(bench, "flask_2"),
        "from_id": node(bench, "bench_1"),
        "to_id": node(bench, "lab"),
    }
    _, looked = post(bench, carry, role="admin", at="/check")
    assert looked["findings"] == []
    assert post(bench, carry, role="admin")[0] == 201
    assert post(bench, archive(bench, "flask_2"), role="admin")[0] == 201


def test_what_a_transfer_uses_is_not_carried_away_under_it(bench: Bench) -> None:
    edge = an_edge(bench)
    run = a_run(bench, move("a", "water", "reactor_1"))
    services.dispatch_ready()
    edge.begin(Attempt.objects.get(job__run=run, job__state="dispatched"))
    for thing in ("water", "bench_1"):
        status, told = post(bench, archive(bench, thing), role="admin")
        assert status in {412, 423}, told
    assert post(bench, archive(bench, "bench_1"), role="admin")[1]["code"] in {
        "crutd.locked",
        "crutd.held_by_run",
        "crutd.connected",
    }


def test_the_page_of_a_run_and_the_list_say_what_it_holds_and_waits_for(bench: Bench) -> None:
    an_edge(bench)
    first = a_run(bench, move("a", "water", "reactor_1"))
    second = a_run(bench, move("a", "acid", "reactor_1"))
    services.dispatch_ready()
    client = signed_in(bench.people["chemist"])
    page = read(client, f"/api/v1/runs/{first.pk}")
    held = {one["resource"]: one for one in page["holds"]}
    assert held["Reactor 1"]["until_step"] == 1
    assert held["Reactor 1"]["is_shared"] is False
    assert held["Water"]["is_shared"] is True
    rows = {row["number"]: row for row in read(client, "/api/v1/runs")["runs"]}
    assert rows[second.number]["waits_for"]["number"] == first.number
    assert {one["resource"] for one in rows[first.number]["holds"]} == set(held)
    tree = read(client, "/api/v1/resources")["resources"]
    reactor = next(row for row in tree if row["key"] == "reactor_1")
    assert reactor["held_by"] == [
        {"run_id": str(first.pk), "run": first.number, "until_step": 1, "is_shared": False}
    ]


def test_a_step_that_is_planned_anew_claims_what_it_uses_now(bench: Bench) -> None:
    edge = an_edge(bench)
    run = a_run(bench, move("a", "water", "reactor_1"))
    services.dispatch_ready()
    attempt = Attempt.objects.get(job__run=run, job__state="dispatched")
    edge.report("rejected", attempt.id, code="device.limit", message="no")
    services.recover_job(
        attempt.job_id,
        actor=bench.people["chemist"],
        choice="change",
        note="the flask",
        params={"target": node(bench, "flask_2")},
    )
    services.resume_run(run.pk, actor=bench.people["chemist"])
    services.dispatch_ready()
    assert "flask_2" in held_by(run)
    assert "reactor_1" not in held_by(run)


def test_a_run_that_was_started_before_there_were_claims_declares_them_when_it_asks(
    bench: Bench,
) -> None:
    an_edge(bench)
    run = a_run(bench, move("a", "water", "reactor_1"))
    declared = Run.objects.get(pk=run.pk).claims
    Run.objects.filter(pk=run.pk).update(claims=None)
    services.dispatch_ready()
    assert Run.objects.get(pk=run.pk).claims == declared
