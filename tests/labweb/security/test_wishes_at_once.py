"""Keys over restarts and at the same moment, and what a refusal, a crash and time do to them."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from typing import Any
from uuid import uuid4

import pytest
from django.db import connection
from django.db.transaction import atomic
from django.http import HttpResponse
from django.test import Client

from labweb.accounts import services as account_services
from labweb.accounts.models import AuditEntry, KeptAnswer
from labweb.common.clock import now
from labweb.common.database import sessions
from labweb.enrollment.models import JoinToken
from labweb.runs import services
from labweb.runs.models import Run
from labweb.workflows.models import Workflow
from tests.builders import MOVE_WATER, Bench, a_lab
from tests.labweb.web import call, code_of, signed_in

RUNS = "/api/v1/runs"
NEW_TOKEN = "/admin/enrollment/jointoken/new/"


def at_once(*acts: Callable[[], HttpResponse]) -> list[HttpResponse]:
    """Do several things at the same moment, each with a connection of its own."""
    begin = threading.Barrier(len(acts))

    def do(act: Callable[[], HttpResponse]) -> HttpResponse:
        begin.wait()
        try:
            return act()
        finally:
            connection.close()

    with ThreadPoolExecutor(len(acts)) as pool:
        return list(pool.map(do, acts))


def starting(bench: Bench, key: str, **said: object) -> HttpResponse:
    """Start the water workflow as the chemist."""
    wanted = {"version_id": str(bench.version(MOVE_WATER).id), **said}
    return call(signed_in(bench.people["chemist"]), "POST", RUNS, wanted, key)


@pytest.mark.django_db(transaction=True)
def test_the_same_start_sent_twice_at_once_makes_one_run() -> None:
    bench, key = a_lab(), str(uuid4())
    answers = at_once(*[lambda: starting(bench, key)] * 2)
    assert [answer.status_code for answer in answers] == [201, 201], answers[0].content
    assert answers[0].content == answers[1].content
    assert sorted("Idempotency-Replayed" in answer for answer in answers) == [False, True]
    assert Run.objects.count() == 1


@pytest.mark.django_db(transaction=True)
def test_two_starts_at_once_by_two_keys_make_one_run_and_one_question() -> None:
    bench = a_lab()
    answers = at_once(*[lambda: starting(bench, str(uuid4()))] * 2)
    assert sorted(answer.status_code for answer in answers) == [201, 409]
    assert Run.objects.count() == 1


@pytest.mark.django_db(transaction=True)
def test_the_first_answer_is_given_again_over_a_new_connection() -> None:
    bench, key = a_lab(), str(uuid4())
    first = starting(bench, key)
    connection.close()
    again = starting(bench, key)
    assert (again.status_code, again.content) == (201, first.content)
    assert Run.objects.count() == 1


@pytest.mark.django_db(transaction=True)
def test_while_the_first_is_being_carried_out_the_second_is_told_when_to_ask_again() -> None:
    bench, key = a_lab(), str(uuid4())
    may_end, has_begun = threading.Event(), threading.Event()
    chemist = bench.people["chemist"]

    def slow() -> account_services.WishAnswer:
        has_begun.set()
        assert may_end.wait(30)
        return account_services.WishAnswer(200, b"{}", {})

    def first() -> None:
        account_services.carry_out_once(slow, actor=chemist, key=key, digest="0" * 64)
        connection.close()

    thread = threading.Thread(target=first)
    thread.start()
    assert has_begun.wait(30)
    answer = starting(bench, key)
    may_end.set()
    thread.join()
    assert (answer.status_code, code_of(answer)) == (409, "http.in_progress")
    assert answer["Retry-After"] == "1"
    assert not Run.objects.exists()


@pytest.mark.django_db(transaction=True)
def test_what_fails_before_its_answer_is_kept_changes_nothing_and_may_be_sent_again() -> None:
    bench, key = a_lab(), str(uuid4())
    chemist, count = bench.people["chemist"], Workflow.objects.count()

    class PowerCutError(Exception):
        pass

    def cut() -> account_services.WishAnswer:
        services.start_run(bench.version(MOVE_WATER), actor=chemist)
        raise PowerCutError

    with pytest.raises(PowerCutError):
        account_services.carry_out_once(cut, actor=chemist, key=key, digest="0" * 64)
    assert not Run.objects.exists()
    assert not KeptAnswer.objects.exists()
    assert Workflow.objects.count() >= count
    assert starting(bench, key).status_code == 201


def test_a_refusal_is_the_answer_to_its_key_and_a_new_key_asks_again(bench: Bench) -> None:
    key = str(uuid4())
    services.stop_lab(actor=bench.people["chemist"])
    refused = starting(bench, key)
    assert (refused.status_code, code_of(refused)) == (412, "run.lab_stopped")
    services.reset_lab(actor=bench.people["approver"], reason="looked")
    assert starting(bench, key).content == refused.content
    assert not Run.objects.exists()
    assert starting(bench, str(uuid4())).status_code == 201


def test_a_request_that_could_not_be_read_uses_up_no_key(bench: Bench) -> None:
    key, client = str(uuid4()), signed_in(bench.people["chemist"])
    wrong = call(client, "POST", RUNS, {"version": "1"}, key)
    assert (wrong.status_code, code_of(wrong)) == (422, "http.body")
    assert starting(bench, key).status_code == 201


def test_what_a_refusal_put_on_record_stays_on_record(bench: Bench) -> None:
    before = Run.objects.count()
    chemist = bench.people["chemist"]

    def recorded() -> account_services.WishAnswer:
        with atomic():
            account_services.write_audit("something.differs", "it", actor=chemist)
        return account_services.WishAnswer(422, b"{}", {})

    for _ in range(2):
        account_services.carry_out_once(recorded, actor=chemist, key="k" * 8, digest="0" * 64)
    rows = AuditEntry.objects.filter(action="something.differs")
    assert rows.count() == 1
    assert Run.objects.count() == before


def test_an_answer_is_kept_for_a_week_and_then_forgotten(bench: Bench) -> None:
    starting(bench, str(uuid4()))
    assert account_services.forget_answers() == 0
    almost = account_services.KEPT_FOR - timedelta(minutes=1)
    KeptAnswer.objects.update(at=now() - almost)
    assert account_services.forget_answers() == 0
    KeptAnswer.objects.update(at=now() - account_services.KEPT_FOR - timedelta(minutes=1))
    assert account_services.forget_answers() == 1


def test_a_second_run_is_asked_about_while_the_first_has_not_begun(bench: Bench) -> None:
    first: Any = starting(bench, str(uuid4()))
    asked: Any = starting(bench, str(uuid4()))
    assert (asked.status_code, code_of(asked)) == (409, "run.already_waiting")
    (named,) = asked.json()["context"]["runs"]
    assert (named["id"], named["number"]) == (first.json()["id"], first.json()["number"])
    assert f"#{named['number']}" in asked.json()["message"]
    assert Run.objects.count() == 1
    assert starting(bench, str(uuid4()), is_second=True).status_code == 201
    assert Run.objects.count() == 2


def test_a_run_that_has_begun_or_ended_is_no_reason_to_ask(bench: Bench) -> None:
    starting(bench, str(uuid4()))
    Run.objects.update(started_at=now(), state="running")
    assert starting(bench, str(uuid4())).status_code == 201
    Run.objects.filter(started_at=None).update(state="aborted", ended_at=now())
    assert starting(bench, str(uuid4())).status_code == 201


def test_a_form_of_the_admin_pages_acts_once_however_often_it_is_sent(bench: Bench) -> None:
    admin = Client(enforce_csrf_checks=True)
    admin.force_login(bench.people["admin"])
    session = admin.session
    sessions.begin(session)
    session.save()

    def a_form() -> dict[str, str]:
        page = admin.get(NEW_TOKEN).content.decode()
        found = re.search(r'name="csrfmiddlewaretoken" value="(\w+)"', page)
        assert found is not None
        return {"csrfmiddlewaretoken": found[1], "name": "Bench 9", "minutes": "5"}

    form = a_form()
    first, second = admin.post(NEW_TOKEN, form), admin.post(NEW_TOKEN, form)
    assert (first.status_code, second.status_code) == (200, 200), first.content
    assert first.content == second.content, "the token is shown to whoever sees the second page"
    assert JoinToken.objects.count() == 1
    admin.post(NEW_TOKEN, a_form())
    assert JoinToken.objects.count() == 2
