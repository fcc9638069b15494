"""A person states lots in the place of a job: what is left of the run is planned again."""

from __future__ import annotations

from typing import Any

import pytest

from labweb.accounts.models import AuditEntry
from labweb.crutd.models import Holding
from labweb.domain.errors import DefinitionError
from labweb.runs import services
from labweb.runs.models import Job, Run
from tests.builders import Bench
from tests.labweb.runs.drawn import a_run
from tests.labweb.runs.hosts import Host
from tests.labweb.web import call, code_of, read, signed_in


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


def parting(bench: Bench, **more: object) -> Run:
    vessel, target = str(bench.node("water").id), str(bench.node("reactor_1").id)
    step: dict[str, Any] = {"vessel": vessel, "target": target, "settle_for": "1 s", **more}
    return a_run(bench, ("wait", {"duration": "1 s"}), ("separate", step), WAIT)


WAIT = ("wait", {"duration": "2 s"})


def finish(host: Host) -> None:
    while services.dispatch_ready():
        host.take()
        while host.step():
            pass
        host.tell()


def held_nl(bench: Bench, key: str) -> int:
    return sum(row.amount_nl for row in Holding.objects.filter(resource=bench.node(key)))


def due(run: Run) -> Job:
    (job,) = Job.objects.filter(run=run, passed_by="").exclude(asks="")
    return job


def test_what_is_stated_is_what_is_drawn_and_booked(bench: Bench, host: Host) -> None:
    run = parting(bench)
    before = held_nl(bench, "reactor_1")
    finish(host)
    asked = due(run)
    assert asked.state == "queued"
    chemist = signed_in(bench.people["chemist"])
    shown = read(chemist, f"/api/v1/runs/{run.id}")
    (asks,) = [job["asks"] for job in shown["jobs"] if job["asks"]]
    (lot,) = asks["states"]["lots"]
    assert asks["states"]["label"] == "Lower layer"
    assert lot["held_ul"] == held_nl(bench, "water") / 1000
    body = {"stated": {lot["key"]: "3 mL"}}
    answer = call(chemist, "POST", f"/api/v1/jobs/{asked.id}/confirm", body)
    assert answer.status_code == 200, answer.content
    asked.refresh_from_db()
    assert (asked.state, asked.passed_by) == ("stopped", "change")
    finish(host)
    assert Run.objects.get(pk=run.pk).state == "complete"
    assert held_nl(bench, "reactor_1") == before + 3_000_000
    told = AuditEntry.objects.get(action="job.state").detail
    assert told["params"] == {"lower": {lot["key"]: "3 mL"}}
    assert "s1" in Run.objects.get(pk=run.pk).plan["proved"]["steps"]


def test_nothing_is_stated_that_the_rest_of_the_run_cannot_do(bench: Bench, host: Host) -> None:
    run = parting(bench)
    finish(host)
    asked, chemist = due(run), signed_in(bench.people["chemist"])
    jobs = Job.objects.filter(run=run).count()

    def code(body: dict[str, Any]) -> str:
        return str(code_of(call(chemist, "POST", f"/api/v1/jobs/{asked.id}/confirm", body)))

    assert code({}) == "run.nothing_stated"
    assert code({"stated": {"gold": "all"}}) == "plan.no_lot"
    assert code({"stated": {"water_lot": "900 L"}}) == "crutd.insufficient_volume"
    assert code({"stated": {"water_lot": "three"}}) == "unit.unreadable"
    asked.refresh_from_db()
    assert (asked.state, asked.confirmed_by) == ("queued", None)
    assert Job.objects.filter(run=run).count() == jobs


def test_a_question_takes_no_amounts(bench: Bench, host: Host) -> None:
    run = a_run(bench, ("confirm", {"question": "Is it closed?"}))
    with pytest.raises(DefinitionError) as caught:
        services.confirm_job(due(run).id, actor=bench.people["chemist"], stated={"water": "all"})
    assert caught.value.code == "run.bad_amount"


def test_what_another_branch_does_is_waited_for(bench: Bench, host: Host) -> None:
    run = parting(bench)
    finish(host)
    asked = due(run)
    other = Job.objects.filter(run=run, index__gt=asked.index).last()
    assert other is not None
    Job.objects.filter(pk=other.pk).update(state="dispatched")
    chemist = signed_in(bench.people["chemist"])
    body = {"stated": {"water_lot": "3 mL"}}
    answer = call(chemist, "POST", f"/api/v1/jobs/{asked.id}/confirm", body)
    assert code_of(answer) == "run.under_way"


def test_what_has_no_jobs_before_the_answer_is_done_after_it(bench: Bench, host: Host) -> None:
    """Half of the water would run the reactor over: what comes after that has no jobs at first."""
    water, reactor = str(bench.node("water").id), str(bench.node("reactor_1").id)
    first = {"vessel": water, "target": reactor, "settle_for": "1 s"}
    flask = str(bench.node("flask_1").id)
    again = {
        "vessel": reactor,
        "target": flask,
        "settle_for": "1 s",
        "lower": {"water_lot": "2 mL"},
    }
    run = a_run(bench, ("separate", first), ("separate", again), WAIT)
    finish(host)
    assert not Job.objects.filter(run=run, step_id="s1", action="aspirate").exists()
    stated = {"water_lot": "9 mL"}
    services.confirm_job(due(run).id, actor=bench.people["chemist"], stated=stated)
    finish(host)
    assert Run.objects.get(pk=run.pk).state == "complete"
    assert held_nl(bench, "flask_1") == 2_000_000


def test_a_vessel_that_an_edge_fills_in_is_known_when_the_rest_is_planned(
    bench: Bench, host: Host
) -> None:
    water, reactor = str(bench.node("water").id), str(bench.node("reactor_1").id)
    pour = {"source": water, "target": str(bench.node("flask_1").id), "volume": "6 mL"}
    part = {"target": reactor, "settle_for": "1 s"}
    edge = {"id": "m", "source": "s0", "source_port": "target"}
    edge |= {"target": "s1", "target_port": "vessel"}
    run = a_run(bench, ("transfer", pour), ("separate", part), edges=[edge])
    before = held_nl(bench, "reactor_1")
    finish(host)
    services.confirm_job(due(run).id, actor=bench.people["chemist"], stated={"water_lot": "2 mL"})
    finish(host)
    assert Run.objects.get(pk=run.pk).state == "complete"
    assert held_nl(bench, "reactor_1") == before + 2_000_000


@pytest.mark.parametrize("is_last", [False, True])
def test_where_nothing_is_meant_the_step_is_left_out_and_the_run_goes_on(
    bench: Bench, host: Host, is_last: bool
) -> None:
    vessel, target = str(bench.node("water").id), str(bench.node("reactor_1").id)
    step = {"vessel": vessel, "target": target, "settle_for": "1 s"}
    run = a_run(bench, WAIT, ("separate", step), *(() if is_last else (WAIT,)))
    before = held_nl(bench, "reactor_1")
    finish(host)
    services.confirm_job(due(run).id, actor=bench.people["chemist"], stated={})
    finish(host)
    assert Run.objects.get(pk=run.pk).state == "complete"
    assert held_nl(bench, "reactor_1") == before
    waits = Job.objects.filter(run=run, action="wait", state="complete")
    assert waits.count() == (1 if is_last else 2)
