"""Two runs, one pump; and stops that come and go."""

from __future__ import annotations

from uuid import UUID

import pytest

from labweb.domain.errors import StateError
from labweb.runs import services
from labweb.runs.models import Attempt, Job, Outbox, Run
from tests.builders import a_lab, a_started_run, an_edge, to_transfer

pytestmark = pytest.mark.django_db

WATER = "Move 5 mL of water"


def states(run_id: UUID) -> list[str]:
    """Return the states of a run's jobs in plan order."""
    return list(Job.objects.filter(run_id=run_id).order_by("index").values_list("state", flat=True))


def test_a_second_run_waits_until_the_first_has_emptied_the_pump() -> None:
    bench = a_lab()
    edge = an_edge(bench)
    first = a_started_run(bench, WATER)
    second = a_started_run(bench, WATER)
    assert services.dispatch_ready() == 1
    edge.complete(Attempt.objects.get(job__run=first))
    assert services.dispatch_ready() == 1
    assert states(first.id)[1] == "dispatched"
    assert set(states(second.id)) == {"queued"}
    second.refresh_from_db()
    assert second.waits is not None
    assert second.waits["run_id"] == str(first.id)
    edge.complete(Attempt.objects.get(job__run=first, job__state="dispatched"))
    edge.work_off(first)
    assert set(states(first.id)) == {"complete"}
    assert states(second.id)[0] == "dispatched"


def test_a_zero_that_was_planned_for_an_empty_syringe_is_held_back_when_it_is_full() -> None:
    # Both runs find the pump without its zero, and plan one. The first draws and is given up.
    bench = a_lab()
    edge = an_edge(bench)
    first, second = a_started_run(bench, WATER), a_started_run(bench, WATER)
    edge.complete(to_transfer(first, edge))
    services.abort_run(first.id, actor=bench.people["chemist"], reason="wrong bottle")
    assert "dispatched" not in states(first.id)
    services.dispatch_ready()
    zero = Job.objects.get(run=second, index=0)
    assert (zero.action, zero.state, zero.code) == ("initialize", "held", "crutd.not_empty")
    assert "5.00 mL" in zero.message
    assert Run.objects.get(pk=second.pk).state == "paused"


def test_two_steps_that_draw_from_the_same_bottle_take_turns_stroke_by_stroke() -> None:
    # Water ──▶ Pump 1 ──▶ Reactor 1
    #       └─▶ Pump 2 ──▶ Flask 2
    bench = a_lab()
    edge = an_edge(bench)
    first, second = a_started_run(bench, WATER), a_started_run(bench, "Try an error")
    drawing = to_transfer(first, edge)
    stroke = Job.objects.filter(run=second, operation__op="transfer_liquid").order_by("index")[0]
    for attempt in Attempt.objects.filter(job__run=second, job__state="dispatched"):
        edge.complete(attempt)
        services.dispatch_ready()
    for attempt in Attempt.objects.filter(job__run=second, job__state="dispatched"):
        edge.complete(attempt)
        services.dispatch_ready()
    assert states(first.id)[drawing.job.index] == "dispatched"
    assert states(second.id)[stroke.index] == "queued"
    edge.complete(drawing)
    services.dispatch_ready()
    assert states(second.id)[stroke.index] == "dispatched"
    while sent := Attempt.objects.filter(job__state="dispatched"):
        for attempt in sent:
            edge.complete(attempt)
        services.dispatch_ready()
    assert set(states(first.id)) == set(states(second.id)) == {"complete"}


def test_a_stop_gives_up_the_resets_before_it() -> None:
    bench = a_lab()
    an_edge(bench)
    services.stop_lab(actor=bench.people["chemist"])
    services.reset_lab(actor=bench.people["admin"], reason="looked")
    assert Outbox.objects.filter(kind="reset", settled_at__isnull=True).count() == 1
    services.stop_lab(actor=bench.people["chemist"])
    assert not Outbox.objects.filter(kind="reset", settled_at__isnull=True).exists()


def test_a_run_approved_while_the_lab_is_stopped_waits_for_a_person() -> None:
    bench = a_lab()
    an_edge(bench)
    run = a_started_run(bench, "Heat and stir")
    services.stop_lab(actor=bench.people["chemist"])
    request = bench.lab.approvals.get(run_id=run.id)
    services.decide_request(
        request.id, actor=bench.people["approver"], is_approved=True, comment=""
    )
    services.reset_lab(actor=bench.people["admin"], reason="looked")
    run.refresh_from_db()
    assert run.state == "paused"
    assert services.dispatch_ready() == 0


def test_an_ended_run_is_not_resumed() -> None:
    bench = a_lab()
    an_edge(bench)
    run = a_started_run(bench, WATER)
    services.abort_run(run.id, actor=bench.people["chemist"], reason="enough")
    with pytest.raises(StateError) as refused:
        services.resume_run(run.id, actor=bench.people["chemist"])
    assert refused.value.code == "run.ended"


def test_a_run_with_a_job_that_ended_undone_is_not_resumed_and_says_why() -> None:
    bench = a_lab()
    edge = an_edge(bench)
    run = a_started_run(bench, WATER)
    services.dispatch_ready()
    attempt = Attempt.objects.get(job__run=run)
    edge.report("rejected", attempt.id, code="device.limit", message="no")
    services.pause_run(run.id, actor=bench.people["chemist"])
    before = states(run.id)
    assert before[0] == "rejected"
    with pytest.raises(StateError) as refused:
        services.resume_run(run.id, actor=bench.people["chemist"])
    assert refused.value.code == "run.cannot_go_on"
    assert "ended rejected" in refused.value.message
    run.refresh_from_db()
    assert (run.state, len(run.pause_reasons), states(run.id)) == ("paused", 1, before)
    services.abort_run(run.id, actor=bench.people["chemist"], reason="start anew")
    run.refresh_from_db()
    assert run.state == "aborted"
