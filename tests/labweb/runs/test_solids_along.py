"""Solids go along with a liquid as a person states it, in the record to the microgram."""

from __future__ import annotations

import pytest

from labweb.crutd.models import Holding
from labweb.domain.errors import Effect
from labweb.domain.runs.host_journal.action_states import ActionReport
from labweb.resources.models import Lot, Resource
from labweb.runs import services
from labweb.runs.models import Job, Run
from tests.builders import Bench
from tests.labweb.crutd.hand import post, pour, refused, solid
from tests.labweb.runs.drawn import a_run
from tests.labweb.runs.hosts import Host
from tests.labweb.runs.test_stated_lots import WAIT, due, finish, held_nl
from tests.labweb.web import call, code_of, read, signed_in


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


def salted(bench: Bench, mass_ug: int) -> None:
    """Give a salt into the water."""
    vessel = bench.node("water")
    Resource.objects.filter(pk=vessel.pk).update(config=vessel.config | {"capacity_mg": 1000})
    assert post(bench, solid(bench, "water", mass_ug, key="salt"))[0] == 201


def held_ug(bench: Bench, key: str) -> int:
    return sum(row.amount_ug for row in Holding.objects.filter(resource=bench.node(key)))


@pytest.mark.parametrize("execution", [None, {"on_disconnect": "continue", "max_offline_s": 60}])
def test_a_solid_goes_along_as_a_person_states_it(
    bench: Bench, host: Host, execution: dict[str, object] | None
) -> None:
    salted(bench, 900_000)
    move = {"source": str(bench.node("water").id), "target": str(bench.node("reactor_1").id)}
    more = {} if execution is None else {"execution": execution}
    run = a_run(bench, ("transfer", {**move, "volume": "30 mL"}), WAIT, **more)
    finish(host)
    asked, chemist = due(run), signed_in(bench.people["chemist"])
    shown = read(chemist, f"/api/v1/runs/{run.id}")
    (asks,) = [job["asks"] for job in shown["jobs"] if job["asks"]]
    (lot,) = asks["states"]["lots"]
    assert (lot["key"], lot["held_ul"], lot["held_mg"]) == ("salt", None, 900.0)
    assert (asks["states"]["label"], asks["states"]["leaves_out"]) == (
        "Solids that go along",
        False,
    )
    at = f"/api/v1/jobs/{asked.id}/confirm"
    assert code_of(call(chemist, "POST", at, {"stated": {}})) == "run.nothing_stated"
    assert code_of(call(chemist, "POST", at, {"stated": {"salt": "1 g"}})) == (
        "crutd.insufficient_mass"
    )
    before = held_nl(bench, "reactor_1")
    answer = call(chemist, "POST", at, {"stated": {"salt": "100.001 mg"}})
    assert answer.status_code == 200, answer.content
    finish(host)
    run.refresh_from_db()
    assert run.state == "complete", [(j.sentence, j.message) for j in run.jobs.all()]
    assert held_nl(bench, "reactor_1") == before + 30_000_000
    assert (held_ug(bench, "water"), held_ug(bench, "reactor_1")) == (799_999, 100_001)
    assert run.plan["proved"]["steps"] == ["s0"]
    told = read(chemist, f"/api/v1/runs/{run.id}/events")["events"]
    moved = [one for one in told if one["amount_nl"]]
    assert sum(one["amount_ug"] for one in moved) == 2 * 100_001
    assert "mg" in moved[0]["summary"]


def test_of_a_broken_stroke_the_same_share_of_a_solid_went_along(bench: Bench, host: Host) -> None:
    salted(bench, 900_000)
    move = {"source": str(bench.node("water").id), "target": str(bench.node("reactor_1").id)}
    run = a_run(bench, ("transfer", {**move, "volume": "2 mL", "solids": {"salt": "80 mg"}}))
    while True:
        services.dispatch_ready()
        host.take()
        started = host.begin()
        if started.do.action == "aspirate":
            break
        host.end(started, ActionReport(ok=True))
        host.tell()
    broken = ActionReport(ok=False, effect=Effect.PARTIAL, moved_nl=500_000, code="pump.blocked")
    host.end(started, broken)
    host.tell()
    assert Job.objects.get(run=run, action="aspirate").state == "aborted"
    assert held_ug(bench, "water") == 880_000
    drawn = Holding.objects.filter(resource__kind="syringe_pump")
    assert sum(row.amount_ug for row in drawn) == 20_000
    chemist = signed_in(bench.people["chemist"])
    job = Job.objects.get(run=run, action="aspirate")
    body = {"choice": "done_by_hand", "moved_ul": 1500, "note": "drawn with a pipette"}
    answer = call(chemist, "POST", f"/api/v1/jobs/{job.id}/recover", body)
    assert answer.status_code == 200, answer.content
    assert held_ug(bench, "water") == 820_000
    assert sum(row.amount_ug for row in drawn.all()) == 80_000


def test_where_no_solid_is_left_the_run_goes_on_without_one(bench: Bench, host: Host) -> None:
    salted(bench, 900_000)
    water = bench.node("water")
    move = {"source": str(water.id), "target": str(bench.node("reactor_1").id)}
    run = a_run(bench, ("transfer", {**move, "volume": "2 mL"}))
    finish(host)
    liquids = Holding.objects.filter(resource=water, amount_nl__gt=0)
    taken = {
        **{"op": "correct", "resource_id": str(water.id), "account": "SUSPENSE"},
        "reason": "it was none",
        "measured_nl": {str(row.lot_id): row.amount_nl for row in liquids},
    }
    assert post(bench, taken)[0] == 201
    chemist = signed_in(bench.people["chemist"])
    at = f"/api/v1/jobs/{due(run).id}/confirm"
    assert code_of(call(chemist, "POST", at, {})) == "run.nothing_stated"
    answer = call(chemist, "POST", at, {"stated": {}})
    assert answer.status_code == 200, answer.content
    finish(host)
    assert Run.objects.get(pk=run.pk).state == "complete"


def test_solids_need_the_room_that_is_stated(bench: Bench) -> None:
    salted(bench, 900_000)
    reactor = bench.node("reactor_1")
    Resource.objects.filter(pk=reactor.pk).update(config=reactor.config | {"capacity_mg": 50})
    salt = str(Lot.objects.get(key="salt").pk)
    told = pour(bench, "water", "reactor_1", 1_000_000) | {"carries_ug": {salt: 80_000}}
    refused(bench, told, "crutd.capacity_exceeded")
    elsewhere = pour(bench, "water", "flask_1", 1_000_000)
    refused(bench, elsewhere | {"carries_ug": {salt: 900_001}}, "crutd.insufficient_mass")
    refused(bench, told | {"carries_ug": {salt: 1}, "keeps": [salt]}, "crutd.parts_disagree")
    assert post(bench, told | {"carries_ug": {salt: 50_000}})[0] == 201
    assert (held_ug(bench, "water"), held_ug(bench, "reactor_1")) == (850_000, 50_000)
