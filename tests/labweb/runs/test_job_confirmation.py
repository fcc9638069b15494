"""Jobs that wait for a person: nothing is sent before somebody confirmed, and once is enough."""

from __future__ import annotations

import json
from dataclasses import dataclass
from uuid import UUID, uuid4

import pytest
from django.test import Client

from labweb.accounts.models import AuditEntry
from labweb.crutd import services as crutd_services
from labweb.crutd.models import Holding, Ticket
from labweb.domain.crutd import operations
from labweb.domain.crutd.settlement import Outcome, OutcomeKind, settle
from labweb.domain.crutd.snapshot import ResourceState
from labweb.domain.crutd.transaction_states import TransactionState
from labweb.domain.resources.contents_by_lot import Phase
from labweb.resources.models import Lot, Resource
from labweb.runs import selectors, services
from labweb.runs.models import Job, Run
from tests.builders import Bench
from tests.labweb.runs.drawn import a_run
from tests.labweb.runs.hosts import Host
from tests.labweb.web import call, code_of, read, signed_in

QUESTION = "Is the stopcock closed?"


ASK = ("confirm", {"question": QUESTION})
WAIT = ("wait", {"duration": "1 s"})


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


def job_of(run: Run, index: int = 0) -> Job:
    return Job.objects.get(run=run, index=index)


def finish(host: Host) -> None:
    while services.dispatch_ready():
        host.take()
        while host.step():
            pass
        host.tell()


@pytest.mark.parametrize("execution", [None, {"on_disconnect": "continue", "max_offline_s": 60}])
def test_what_is_asked_waits_and_what_comes_after_it_too(
    bench: Bench, host: Host, execution: dict[str, object] | None
) -> None:
    more = {} if execution is None else {"execution": execution}
    run = a_run(bench, WAIT, ASK, WAIT, **more)
    finish(host)
    states = [job.state for job in run.jobs.order_by("index")]
    assert states == ["complete", "queued", "queued"]
    chemist = signed_in(bench.people["chemist"])
    shown = read(chemist, f"/api/v1/runs/{run.id}")
    asks = [job["asks"] for job in shown["jobs"]]
    assert asks[1] == {
        "text": QUESTION,
        "is_due": True,
        "states": None,
        "confirmed_by": None,
        "confirmed_at": None,
    }
    assert asks[0] is asks[2] is None
    (need,) = [one for one in read(chemist, "/api/v1/home")["needs_you"] if one["kind"] == "asks"]
    assert (need["title"], need["run_id"]) == (QUESTION, str(run.id))
    answer = call(chemist, "POST", f"/api/v1/jobs/{job_of(run, 1).id}/confirm", {})
    assert answer.status_code == 200
    told = json.loads(answer.content)["jobs"][1]["asks"]
    assert (told["is_due"], told["confirmed_by"]) == (False, bench.people["chemist"].printed_name)
    finish(host)
    assert Run.objects.get(pk=run.pk).state == "complete"
    assert AuditEntry.objects.get(action="job.confirm").detail["asked"] == QUESTION


def test_a_question_is_answered_once_in_its_turn_and_by_who_may_run(
    bench: Bench, host: Host
) -> None:
    run = a_run(bench, WAIT, ASK)
    first, asked = job_of(run, 0), job_of(run, 1)
    chemist, observer = signed_in(bench.people["chemist"]), signed_in(bench.people["observer"])

    def code(client: Client, job: Job) -> str:
        return str(code_of(call(client, "POST", f"/api/v1/jobs/{job.id}/confirm", {})))

    assert code(chemist, first) == "run.asks_nobody"
    assert code(chemist, asked) == "run.not_asking"
    finish(host)
    assert call(observer, "POST", f"/api/v1/jobs/{asked.id}/confirm", {}).status_code == 403
    services.pause_run(run.id, actor=bench.people["chemist"])
    assert code(chemist, asked) == "run.not_asking"
    services.resume_run(run.id, actor=bench.people["chemist"])
    assert call(chemist, "POST", f"/api/v1/jobs/{asked.id}/confirm", {}).status_code == 200
    assert code(chemist, asked) == "run.confirmed_before"


def test_nothing_is_asked_of_a_run_that_was_given_up(bench: Bench, host: Host) -> None:
    run = a_run(bench, ASK)
    services.abort_run(run.id, actor=bench.people["chemist"], reason="no stopcock")
    chemist = signed_in(bench.people["chemist"])
    answer = call(chemist, "POST", f"/api/v1/jobs/{job_of(run).id}/confirm", {})
    assert code_of(answer) == "run.not_asking"
    assert not [one for one in read(chemist, "/api/v1/home")["needs_you"] if one["kind"] == "asks"]


@dataclass(frozen=True)
class Weighing:
    """A run in which a person is to weigh 2 g of 10 g out of a jar."""

    run: Run
    jar: Resource
    reactor: Resource
    lot_id: UUID

    def held_ug(self) -> tuple[int, int]:
        rows = {row.resource_id: row.amount_ug for row in Holding.objects.filter(lot=self.lot_id)}
        return rows.get(self.jar.id, 0), rows.get(self.reactor.id, 0)

    def is_open(self) -> bool:
        rows = Resource.objects.filter(pk__in=[self.jar.id, self.reactor.id])
        return all(row.quarantined_by is None for row in rows)


@pytest.fixture
def weighing(bench: Bench) -> Weighing:
    jar, reactor = bench.node("flask_1"), bench.node("reactor_1")
    for row in (jar, reactor):
        Resource.objects.filter(pk=row.pk).update(config={**row.config, "capacity_mg": 50_000})
    delivered = operations.Receive(
        lot_id=uuid4(),
        material_id=Lot.objects.all()[0].material_id,
        key="salt",
        phase=Phase.SOLID,
        portions=(operations.Portion(resource_id=jar.id, amount_ug=10_000_000),),
    )
    crutd_services.carry_out(delivered, lab=bench.lab, actor_id=bench.people["chemist"].pk)
    ends = {"source": str(jar.id), "target": str(reactor.id), "mass": "2 g"}
    return Weighing(a_run(bench, ("add_solid", ends)), jar, reactor, delivered.lot_id)


def test_what_a_host_gives_back_unbegun_is_not_booked_and_closes_nothing(
    bench: Bench, host: Host, weighing: Weighing
) -> None:
    services.confirm_job(job_of(weighing.run).id, actor=bench.people["chemist"])
    assert services.dispatch_ready() == 1
    services.abort_run(weighing.run.id, actor=bench.people["chemist"], reason="enough")
    host.take()
    while host.step():
        pass
    host.tell()
    assert job_of(weighing.run).state in {"stopped", "complete"}
    assert weighing.is_open(), "nobody moved anything that is not known"


def test_nothing_moved_of_a_mass_is_settled_without_a_doubt() -> None:
    ends = [ResourceState(id=uuid4(), name=name, kind="bottle") for name in ("jar", "flask")]
    move = operations.TransferMass(
        source_id=ends[0].id, target_id=ends[1].id, amount_ug=5, phase=Phase.SOLID
    )
    nothing = Outcome(kind=OutcomeKind.PARTIAL, moved_nl=0)
    change = settle(move, {one.id: one for one in ends}, nothing)
    assert (change.state, change.postings) == (TransactionState.ROLLED_BACK, ())


def undone(weighing: Weighing) -> Job:
    job = job_of(weighing.run)
    for state in ("dispatched", "rejected"):
        Job.objects.filter(pk=job.pk).update(state=state)
    return job_of(weighing.run)


def test_a_job_that_is_tried_again_asks_again(bench: Bench, weighing: Weighing) -> None:
    chemist = bench.people["chemist"]
    services.confirm_job(job_of(weighing.run).id, actor=chemist)
    job = undone(weighing)
    services.recover_job(job.id, actor=chemist, choice="retry", note="again")
    job.refresh_from_db()
    assert (job.state, job.confirmed_by, job.confirmed_at) == ("queued", None, None)


def test_what_is_done_by_hand_instead_is_booked_as_it_was_planned(
    bench: Bench, weighing: Weighing
) -> None:
    chemist = bench.people["chemist"]
    job = undone(weighing)
    card = selectors.recovery_of(job)
    assert card is not None
    (offered,) = [one for one in card.choices if one.name == "done_by_hand"]
    assert "moves the mass that was planned" in offered.consequence
    services.recover_job(job.id, actor=chemist, choice="done_by_hand", note="weighed")
    assert weighing.held_ug() == (8_000_000, 2_000_000)


def test_a_jar_that_has_become_empty_is_said_before_anybody_confirms(
    bench: Bench, weighing: Weighing
) -> None:
    chemist = bench.people["chemist"]
    away = operations.Dispose(resource_id=weighing.jar.id, amount_ug=9_000_000)
    crutd_services.carry_out(
        away, lab=bench.lab, actor_id=chemist.pk, run_id=weighing.run.id, note="spilt"
    )
    job = job_of(weighing.run)
    answer = call(signed_in(chemist), "POST", f"/api/v1/jobs/{job.id}/confirm", {})
    assert code_of(answer) == "crutd.insufficient_mass"
    assert job_of(weighing.run).confirmed_at is None


def test_what_was_confirmed_and_is_never_booked_is_a_ticket(
    bench: Bench, weighing: Weighing
) -> None:
    chemist = bench.people["chemist"]
    services.confirm_job(job_of(weighing.run).id, actor=chemist)
    services.abort_run(weighing.run.id, actor=chemist, reason="enough")
    assert weighing.held_ug() == (10_000_000, 0)
    (ticket,) = Ticket.objects.filter(code="run.not_booked")
    assert "Take stock of both vessels" in ticket.message


def test_a_solid_is_on_record_when_a_person_has_confirmed_it(
    bench: Bench, host: Host, weighing: Weighing
) -> None:
    assert services.dispatch_ready() == 0
    services.confirm_job(job_of(weighing.run).id, actor=bench.people["chemist"])
    finish(host)
    assert job_of(weighing.run).state == "complete", job_of(weighing.run).message
    assert weighing.held_ug() == (8_000_000, 2_000_000)
