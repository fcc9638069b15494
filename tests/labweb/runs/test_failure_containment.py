"""One run, command or duty that fails in an unforeseen way keeps no other from its turn."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from django.db import connection
from django.db.transaction import atomic
from django.db.utils import OperationalError

from labweb.crutd import services as crutd_services
from labweb.crutd.models import Ticket
from labweb.fleet.management.commands.dispatcher import Duties
from labweb.runs import services
from labweb.runs.models import Job, Outbox, Run
from tests.builders import Bench, a_started_run, an_edge, dispatched, next_job

NO_PAUSE = """
CREATE FUNCTION refuse() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN RAISE EXCEPTION 'no run is paused' USING ERRCODE = '23514'; END $$;
CREATE TRIGGER no_pause BEFORE UPDATE OF pause_reasons ON runs_run
FOR EACH ROW WHEN (NEW.pause_reasons <> '[]') EXECUTE FUNCTION refuse();
"""


def _unknown_operation(run: Run) -> None:
    Job.objects.filter(pk=next_job(run).pk).update(operation={"op": "conjure"})


def _no_list_of_jobs_before(run: Run) -> None:
    Job.objects.filter(pk=next_job(run).pk).update(after=7)


def _no_execution(run: Run) -> None:
    Run.objects.filter(pk=run.pk).update(plan={**run.plan, "execution": 7})


@pytest.mark.parametrize("spoil", [_unknown_operation, _no_list_of_jobs_before, _no_execution])
def test_a_run_that_makes_no_sense_is_paused_and_told_of_and_the_next_one_goes(
    bench: Bench, spoil: Callable[[Run], None]
) -> None:
    broken, sound = a_started_run(bench), a_started_run(bench)
    an_edge(bench)
    spoil(broken)
    for _ in range(3):
        services.dispatch_ready()
    broken.refresh_from_db()
    assert (broken.state, _kinds(broken)) == ("paused", ["server error"])
    ticket = Ticket.objects.get(code="run.not_dispatched")
    assert ticket.detail == {"run_id": str(broken.pk)}
    assert f"run #{broken.number} is paused" in ticket.message
    assert not Outbox.objects.filter(action_id__in=_attempts(broken)).exists()
    assert sound.jobs.filter(state="dispatched").count() == 1
    assert Outbox.objects.filter(action_id__in=_attempts(sound)).count() == 1


def test_a_paused_run_goes_on_once_it_was_put_right_and_a_person_resumes_it(bench: Bench) -> None:
    run = a_started_run(bench)
    an_edge(bench)
    operation = next_job(run).operation
    _unknown_operation(run)
    assert services.dispatch_ready() == 0
    Job.objects.filter(pk=next_job(run).pk).update(operation=operation)
    services.resume_run(run.pk, actor=bench.people["chemist"])
    assert services.dispatch_ready() == 1


def test_a_command_that_cannot_be_sent_is_told_of_once_and_the_others_are_sent(
    bench: Bench,
) -> None:
    run = a_started_run(bench)
    an_edge(bench)
    broken = dispatched(run)
    Outbox.objects.filter(action_id=broken.pk).update(body={"t": "conjure"})
    crutd_services.open_ticket(bench.lab, "host.not_told", "another one", {"host_id": "of it"})
    services.stop_lab(actor=bench.people["chemist"])
    services.reset_lab(actor=bench.people["approver"], reason="looked at every device")
    for _ in range(3):
        services.publish_outbox()
        Outbox.objects.update(published_at=None)
    counts = dict(Outbox.objects.values_list("kind", "publish_count"))
    assert counts == {"do": 0, "cancel": 3, "reset": 3}, "a stop asks back what has not begun"
    tickets = Ticket.objects.filter(code="host.not_told", detail__action_id=str(broken.pk))
    assert tickets.get().detail["host_id"] == str(bench.host.pk)


def test_a_duty_that_fails_is_told_of_once_until_it_works_again(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    doing = Duties()

    def fails() -> int:
        raise KeyError("what no row should hold")

    assert [doing.do("trim telemetry", fails) for _ in range(3)] == [None] * 3
    assert len(caplog.records) == 1
    assert doing.do("trim telemetry", lambda: 4) == 4
    assert doing.do("trim telemetry", fails) is None
    assert len(caplog.records) == 2
    ticket = Ticket.objects.get(lab=bench.lab, code="server.failing")
    assert ticket.detail == {"duty": "trim telemetry"}
    assert "trim telemetry" in ticket.message


def test_a_database_that_is_away_is_no_fault_of_what_was_asked_of_it() -> None:
    def asks() -> None:
        raise OperationalError("away")

    with pytest.raises(OperationalError):
        Duties().do("dispatch jobs", asks)


def test_what_the_database_refuses_while_it_is_there_is_told_as_what_failed(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    def asks(text: str) -> None:
        with atomic(), connection.cursor() as cursor:
            cursor.execute(text)

    slow = partial(asks, "SET LOCAL statement_timeout = 10; SELECT pg_sleep(2)")
    assert Duties().do("count what is late", slow) is None
    assert Ticket.objects.get(code="server.failing").detail == {"duty": "count what is late"}
    full = partial(asks, "DO $$ BEGIN RAISE EXCEPTION 'full' USING ERRCODE = '53100'; END $$")
    with pytest.raises(OperationalError):
        Duties().do("write it down", full)
    caplog.clear()
    crossed = partial(asks, "DO $$ BEGIN RAISE EXCEPTION 'x' USING ERRCODE = '40P01'; END $$")
    assert Duties().do("meet somebody", crossed) is None
    assert [one.levelname for one in caplog.records] == ["WARNING"]
    assert Ticket.objects.count() == 1


def test_a_run_that_cannot_be_paused_either_is_said_once_after_the_others_had_their_turn(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    with connection.cursor() as cursor:
        cursor.execute(NO_PAUSE)
    broken, sound = a_started_run(bench), a_started_run(bench)
    an_edge(bench)
    _unknown_operation(broken)
    doing = Duties()
    for _ in range(3):
        doing.do("dispatch jobs", services.dispatch_ready)
    assert sound.jobs.filter(state="dispatched").count() == 1
    assert Ticket.objects.get(code="server.failing").detail == {"duty": "dispatch jobs"}
    assert len([one for one in caplog.records if one.levelname == "ERROR"]) == 1


def _kinds(run: Run) -> list[Any]:
    return [reason["kind"] for reason in run.pause_reasons]


def _attempts(run: Run) -> list[Any]:
    return list(run.jobs.values_list("attempts__id", flat=True))
