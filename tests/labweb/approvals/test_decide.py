"""Who may answer, and what an answer releases."""

from __future__ import annotations

from datetime import timedelta

import pytest

from labweb.accounts.models import AuditEntry
from labweb.approvals.models import ApprovalRequest, Decision
from labweb.common.clock import now
from labweb.domain.errors import ForbiddenError, StateError
from labweb.fleet.management.commands.dispatcher import Watch
from labweb.runs import services
from labweb.runs.models import Run
from tests.builders import HEAT, MOVE_WATER, Bench, a_started_run, a_user, an_edge


def decide(bench: Bench, role: str, *, is_approved: bool = True) -> ApprovalRequest:
    request = ApprovalRequest.objects.get()
    return services.decide_request(
        request.id, actor=bench.people[role], is_approved=is_approved, comment="seen"
    )


def test_heating_to_sixty_degrees_waits_for_a_second_person(bench: Bench) -> None:
    run = a_started_run(bench, HEAT)
    an_edge(bench)
    assert run.state == "awaiting_approval"
    assert services.dispatch_ready() == 0
    assert ApprovalRequest.objects.get().plan_digest == run.plan_digest


def test_moving_water_asks_nobody(bench: Bench) -> None:
    assert a_started_run(bench, MOVE_WATER).state == "queued"
    assert not ApprovalRequest.objects.exists()


def test_who_asked_may_not_answer(bench: Bench) -> None:
    run = a_started_run(bench, HEAT, actor="approver")
    with pytest.raises(ForbiddenError) as refusal:
        decide(bench, "approver")
    assert refusal.value.code == "approval.own_request"
    assert Run.objects.get(pk=run.pk).state == "awaiting_approval"
    assert not Decision.objects.exists()


@pytest.mark.parametrize("role", ["observer", "chemist"])
def test_who_may_not_decide_is_refused(bench: Bench, role: str) -> None:
    a_started_run(bench, HEAT)
    with pytest.raises(ForbiddenError):
        decide(bench, role)
    assert not Decision.objects.exists()


def test_an_approval_queues_exactly_the_plan_that_was_shown(bench: Bench) -> None:
    run = a_started_run(bench, HEAT)
    an_edge(bench)
    decide(bench, "approver")
    run.refresh_from_db()
    assert run.state == "queued"
    assert Decision.objects.get().plan_digest == run.plan_digest
    assert services.dispatch_ready() == 1
    assert AuditEntry.objects.filter(action="approval.decide").count() == 1


def test_the_first_answer_wins(bench: Bench) -> None:
    run = a_started_run(bench, HEAT)
    decide(bench, "approver", is_approved=False)
    second = a_user("approver", on=bench.node("lab"), name="second")
    with pytest.raises(StateError) as refusal:
        services.decide_request(
            ApprovalRequest.objects.get().id, actor=second, is_approved=True, comment=""
        )
    assert refusal.value.code == "approval.answered"
    assert Decision.objects.get().is_approved is False
    run.refresh_from_db()
    assert run.state == "aborted"
    assert set(run.jobs.values_list("state", flat=True)) == {"stopped"}


def test_a_request_that_has_expired_releases_nothing(bench: Bench) -> None:
    a_started_run(bench, HEAT)
    ApprovalRequest.objects.update(expires_at=now() - timedelta(seconds=1))
    with pytest.raises(StateError):
        decide(bench, "approver")
    assert not Decision.objects.exists()


def test_a_request_whose_time_is_over_ends_its_run_and_is_written_so(bench: Bench) -> None:
    run = a_started_run(bench, HEAT)
    assert services.expire_requests() == 0
    ApprovalRequest.objects.update(expires_at=now() - timedelta(seconds=1))
    for duty in Watch().duties:
        duty()
    assert ApprovalRequest.objects.get().state == "expired"
    run.refresh_from_db()
    assert (run.state, run.ended_at is None) == ("aborted", False)
    jobs = run.jobs.values_list("state", "code")
    assert set(jobs) == {("stopped", "approval.expired")}
    written = AuditEntry.objects.filter(action__in=["approval.expire", "run.abort"])
    assert {entry.actor for entry in written} == {None}
    assert written.count() == 2
    assert services.expire_requests() == 0
    with pytest.raises(StateError) as refusal:
        decide(bench, "approver")
    assert refusal.value.code == "approval.answered"
    assert not Decision.objects.exists()


def test_only_what_is_over_expires(bench: Bench) -> None:
    early, late = a_started_run(bench, HEAT), a_started_run(bench, HEAT)
    over = now() - timedelta(seconds=1)
    ApprovalRequest.objects.filter(run_id=early.id).update(expires_at=over)
    assert services.expire_requests() == 1
    found = dict(Run.objects.values_list("pk", "state"))
    assert found == {early.id: "aborted", late.id: "awaiting_approval"}


def test_giving_a_run_up_withdraws_its_question(bench: Bench) -> None:
    run = a_started_run(bench, HEAT)
    services.abort_run(run.id, actor=bench.people["chemist"], reason="not today")
    assert ApprovalRequest.objects.get().state == "withdrawn"
    with pytest.raises(StateError):
        decide(bench, "approver")
