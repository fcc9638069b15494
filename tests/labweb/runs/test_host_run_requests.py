"""A wish of a node beside a host becomes a run that a person approves, or nothing."""

from __future__ import annotations

from typing import Any
from uuid import UUID, uuid4

import pytest
from django.core.management import CommandError, call_command

from labweb.accounts.models import AuditEntry
from labweb.approvals.models import ApprovalRequest
from labweb.domain.errors import ForbiddenError
from labweb.domain.messages.action_asks import ActionAsk, AskTold
from labweb.runs import services
from labweb.runs.models import Attempt, Run
from labweb.runs.services import host_run_requests
from tests.builders import Bench, an_edge, dispatched

TIMER = "timer_1"


def an_ask(bench: Bench, key: str = TIMER, **changes: Any) -> ActionAsk:  # noqa: ANN401 - any field
    fields: dict[str, Any] = {
        "epoch": 1,
        "ask_id": uuid4(),
        "device_id": bench.device(key).id,
        "action": "wait",
        "args": {"duration_s": 5.0},
        "source": "ros2",
    }
    return ActionAsk(**(fields | changes))


def take(bench: Bench, ask: ActionAsk) -> AskTold:
    return services.take_ask(bench.host.id, ask)


@pytest.fixture
def open_bench(bench: Bench) -> Bench:
    people = bench.people
    services.let_ask(bench.host.id, name=people["chemist"], actor=people["admin"])
    return bench


def test_nobody_may_ask_unless_an_admin_said_so(bench: Bench) -> None:
    told = take(bench, an_ask(bench))
    assert (told.state, told.is_final) == ("refused", True)
    assert not Run.objects.exists()


def test_a_wish_waits_for_a_person_who_is_not_the_one_it_is_in_the_name_of(
    open_bench: Bench,
) -> None:
    told = take(open_bench, an_ask(open_bench))
    assert (told.state, told.is_final) == ("awaiting_approval", False)
    run = Run.objects.get(number=told.run_number)
    assert run.created_by == open_bench.people["chemist"]
    request = ApprovalRequest.objects.get(run_id=run.id)
    assert host_run_requests.RULE in request.policies
    assert not request.allow_self
    assert not Attempt.objects.exists()
    assert AuditEntry.objects.filter(action="run.asked", subject=str(run.id)).exists()


def test_once_approved_it_goes_the_signed_way_and_is_told_to_its_end(open_bench: Bench) -> None:
    ask = an_ask(open_bench)
    run = Run.objects.get(number=take(open_bench, ask).run_number)
    edge = an_edge(open_bench)
    services.decide_request(
        ApprovalRequest.objects.get(run_id=run.id).id,
        actor=open_bench.people["approver"],
        is_approved=True,
        comment="",
    )
    services.dispatch_ready()
    attempt = dispatched(run)
    assert attempt.job.action == "wait"
    edge.begin(attempt)
    assert services.asks_told(open_bench.host.id, [ask.ask_id])[0].state == "running"
    edge.report("actuated", attempt.id, report={"ok": True})
    edge.finish(attempt)
    told = services.asks_told(open_bench.host.id, [ask.ask_id])[0]
    assert (told.state, told.is_final) == ("complete", True)


def test_the_same_wish_twice_is_one_run(open_bench: Bench) -> None:
    ask = an_ask(open_bench)
    assert take(open_bench, ask) == take(open_bench, ask)
    assert Run.objects.count() == 1


def test_wishes_for_one_action_are_versions_of_one_workflow(open_bench: Bench) -> None:
    for duration_s in (1.0, 2.0, 1.0):
        take(open_bench, an_ask(open_bench, args={"duration_s": duration_s}))
    rows = open_bench.lab.workflows.filter(name__contains="wait")
    assert rows.count() == 1
    assert Run.objects.values("version").distinct().count() > 1


def test_a_rejected_wish_ends_and_moves_nothing(open_bench: Bench) -> None:
    ask = an_ask(open_bench)
    run = Run.objects.get(number=take(open_bench, ask).run_number)
    services.decide_request(
        ApprovalRequest.objects.get(run_id=run.id).id,
        actor=open_bench.people["approver"],
        is_approved=False,
        comment="no",
    )
    told = services.asks_told(open_bench.host.id, [ask.ask_id])[0]
    assert (told.state, told.is_final) == ("stopped", True)


def test_a_withdrawn_wish_is_not_begun(open_bench: Bench) -> None:
    ask = an_ask(open_bench)
    take(open_bench, ask)
    services.withdraw_ask(open_bench.host.id, ask.ask_id)
    services.withdraw_ask(open_bench.host.id, ask.ask_id)
    told = services.asks_told(open_bench.host.id, [ask.ask_id])[0]
    assert (told.state, told.is_final) == ("stopped", True)
    assert not ApprovalRequest.objects.filter(state="open").exists()


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"action": "explode"}, "explode"),
        ({"args": {"duration_s": -1.0}}, "duration_s"),
        ({"args": {}}, "duration_s"),
        ({"args": {"duration_s": 1.0, "text": "x" * 20_000}}, "too long"),
        ({"device_id": UUID(int=5)}, "device"),
    ],
)
def test_what_cannot_be_planned_is_refused_and_leaves_nothing(
    open_bench: Bench, changes: dict[str, Any], reason: str
) -> None:
    told = take(open_bench, an_ask(open_bench, **changes))
    assert told.state == "refused"
    assert reason in told.message
    assert not Run.objects.exists()
    workflows = open_bench.lab.workflows.filter(name__contains="wait")
    assert not workflows.exists()


def test_a_wish_may_move_no_liquid(open_bench: Bench) -> None:
    key = next(one.key for one in open_bench.file.devices if "tricontinent" in one.driver)
    args = {"volume_ul": 10.0, "rate_ul_s": 10.0}
    told = take(open_bench, an_ask(open_bench, key, action="aspirate", args=args))
    assert told.state == "refused"
    assert "Transfer" in told.message


def test_another_host_can_neither_use_a_wish_nor_a_device(open_bench: Bench) -> None:
    ask = an_ask(open_bench)
    take(open_bench, ask)
    other = uuid4()
    assert services.asks_told(other, [ask.ask_id]) == []
    services.withdraw_ask(other, ask.ask_id)
    assert services.take_ask(other, ask).state == "refused"
    assert not Run.objects.get(ask_id=ask.ask_id).is_given_up


def test_wishes_are_bounded(open_bench: Bench) -> None:
    for _ in range(host_run_requests.MOST_OPEN):
        assert take(open_bench, an_ask(open_bench)).state == "awaiting_approval"
    assert take(open_bench, an_ask(open_bench)).state == "refused"


def test_only_an_admin_says_who_may_ask(bench: Bench) -> None:
    people = bench.people
    with pytest.raises(ForbiddenError):
        services.let_ask(bench.host.id, name=people["chemist"], actor=people["chemist"])
    with pytest.raises(ForbiddenError):
        services.let_ask(bench.host.id, name=people["observer"], actor=people["admin"])
    assert bench.host.asks_as is None


def test_the_command_switches_on_and_off(bench: Bench) -> None:
    admin = bench.people["admin"].get_username()
    name = bench.people["chemist"].get_username()
    call_command("let_ask", bench.host.key, "--user", admin, "--as", name)
    assert bench.host.asks_as == bench.people["chemist"]
    call_command("let_ask", bench.host.key, "--user", admin, "--off")
    assert bench.host.asks_as is None
    with pytest.raises(CommandError):
        call_command("let_ask", "nobody", "--user", admin, "--off")


def test_a_stopped_lab_takes_no_wish(open_bench: Bench) -> None:
    services.stop_lab(actor=open_bench.people["chemist"])
    assert take(open_bench, an_ask(open_bench)).state == "refused"
