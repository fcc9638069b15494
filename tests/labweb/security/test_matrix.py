"""Every URL of the server by every role; a URL that is not in the tables fails."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import cast
from uuid import UUID

import pytest
from django.core.files.uploadedfile import SimpleUploadedFile
from django.db.transaction import atomic, set_rollback
from django.http import HttpResponse
from django.test import Client
from pytest_django import Settings

from labweb.calibration.models import Calibration
from labweb.common.clock import now
from labweb.crutd import services as crutd_services
from labweb.crutd.models import RunHold
from labweb.domain.crutd.operations import Read, TransferLiquid, to_json
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.enrollment.models import EdgeHost
from labweb.runs import services as run_services
from labweb.runs.models import Attempt
from tests.builders import Bench, a_started_run, an_edge
from tests.labweb.instrument_files import TRACE
from tests.labweb.photos import a_photo
from tests.labweb.security.rest_table import API, EVERY, MEMBERS, Form
from tests.labweb.security.things import one_of_each
from tests.labweb.web import call, routes, signed_in
from tests.labweb.web import code_of as error_code_of

PAGES = {"healthz", "^api/", "^(?!api/|admin/|static/|ws/|twin/view).*$"}
MEMBERS_PAGES = {"api/schema/", r"^twin/view(?:/(?P<path>.*))?$"}


def name_of(route: str) -> str:
    """Name a REST route as the table does."""
    plain = route.removeprefix("api/v1/")
    return re.sub(r"<(?:uuid|int):(\w+?)(?:_id)?>", r"<\1>", plain)


def rest_routes() -> Iterator[tuple[str, str]]:
    for route, view in routes():
        if route.startswith("api/v1/"):
            methods = [m for m in ("get", "post", "put", "patch", "delete") if hasattr(view.cls, m)]
            yield from ((method.upper(), name_of(route)) for method in methods)


@pytest.fixture
def ids(bench: Bench, settings: Settings, tmp_path: Path) -> dict[str, str]:
    settings.DATA_DIR = tmp_path
    return one_of_each(bench)


def let_ask(bench: Bench, ids: dict[str, str]) -> None:
    """Let the job wait for nothing but a person who confirms it."""
    asked = bench.lab.runs.get(pk=ids["run"]).jobs.filter(pk=ids["job"])
    if asked.get().state != "queued":
        asked.update(state="rejected")
    look = to_json(Read(device_id=bench.node("timer_1").id))
    asked.update(state="queued", asks="Closed?", operation=look, after=[])
    asked.update(confirmed_by=None, confirmed_at=None)
    bench.lab.runs.filter(pk=ids["run"]).update(pause_reasons=[])


def prepare(bench: Bench, route: str, ids: dict[str, str]) -> None:
    """Bring about what the act needs, for this call alone."""
    chemist = bench.people["chemist"]
    if route == "lab/reset":
        run_services.stop_lab(actor=chemist)
    if route == "runs/<run>/resume":
        run_services.pause_run(UUID(ids["run"]), actor=chemist)
    if route in {"hosts/<host>/fence", "hosts/<host>/readmit"}:
        state = "isolated" if route.endswith("fence") else "quarantined"
        EdgeHost.objects.filter(pk=ids["host"]).update(state=state)
    if route == "resources/<resource>/handover":
        attempt = Attempt.objects.get(job_id=ids["job"])
        nothing = Outcome(kind=OutcomeKind.PARTIAL, moved_nl=0)
        crutd_services.settle(attempt.transaction_id, crutd_services.Settlement(outcome=nothing))
        RunHold.objects.all().delete()
        bench.unplug("water")
    if route == "calibrations/<calibration>/withdraw":
        rows = Calibration.objects.filter(pk=ids["calibration"])
        rows.update(state="accepted", expires_at=now())
    if route == "devices/<heating>/calibrations/temperature":
        dipped = bench.node("reactor_1").id
        water = TransferLiquid(
            source_id=bench.node("acid").id, target_id=dipped, amount_nl=20_000_000
        )
        crutd_services.carry_out(water, lab=bench.lab, actor_id=chemist.pk)
    if route == "jobs/<job>/confirm":
        let_ask(bench, ids)
    if route == "jobs/<job>/recover":
        undone = bench.lab.runs.get(pk=ids["run"]).jobs.get(pk=ids["job"])
        undone.state = "rejected"
        undone.save(update_fields=["state"])
    if route == "jobs/<job>/resolve":
        job = bench.lab.runs.get(pk=ids["run"]).jobs.get(pk=ids["job"])
        job.state = "in_doubt"
        job.save(update_fields=["state"])


def send(
    client: Client, bench: Bench, method: str, route: str, ids: dict[str, str]
) -> HttpResponse:
    path = "/api/v1/" + re.sub(r"<(\w+)>", lambda found: ids[found[1]], route)
    body = API[method, route][1]
    if isinstance(body, dict):
        filled = re.sub(r'"<(\w+)>"', lambda found: f'"{ids[found[1]]}"', json.dumps(body))
        body = json.loads(filled)
    with atomic():
        prepare(bench, route, ids)
        if isinstance(API[method, route][1], Form):
            data = a_photo("blue") if route.endswith("photo") else TRACE.encode() + b"3,1,1,"
            body = {**body, "file": SimpleUploadedFile("b.csv", data)}
            answer = cast(HttpResponse, client.post(path, body))
        else:
            answer = call(client, method, path, body)
        set_rollback(True)
    return answer


def test_every_rest_route_is_in_the_table() -> None:
    assert set(rest_routes()) == {(method, route.split("?")[0]) for method, route in API}


def test_every_other_url_is_a_known_page() -> None:
    others = {r for r, _ in routes() if not r.startswith(("api/v1/", "admin/"))}
    assert others == PAGES | MEMBERS_PAGES


@pytest.mark.parametrize("role", EVERY)
def test_each_role_may_what_the_table_says_and_nothing_else(
    bench: Bench, ids: dict[str, str], role: str
) -> None:
    wrong = []
    for (method, route), (allowed, _) in API.items():
        client = signed_in(bench.people.get(role))
        answer = send(client, bench, method, route, ids)
        expected = answer.status_code < 400 if role in allowed else answer.status_code == 403
        if not expected:
            wrong.append((method, route, answer.status_code, answer.content[:200]))
        if role == "anonymous" and answer.status_code == 403:
            assert error_code_of(answer) == "http.not_authenticated"
    assert not wrong


@pytest.mark.parametrize("role", EVERY)
def test_the_schema_is_for_members(bench: Bench, role: str) -> None:
    answer = signed_in(bench.people.get(role)).get("/api/schema/")
    assert answer.status_code == (200 if role in MEMBERS else 403)


def admin_paths(bench: Bench) -> Iterator[str]:
    for route, _ in routes():
        if not route.startswith("admin/"):
            continue
        path = re.sub(r"<[^>]*>", str(bench.device("ph_1").id), route)
        path = re.sub(r"\(\?P<\w+>[^)]*\)", "x", path).replace("^", "").replace("$", "")
        yield "/" + path


@pytest.mark.parametrize("role", EVERY[:-1])
def test_the_admin_pages_are_closed_to_everybody_but_admins(bench: Bench, role: str) -> None:
    client = signed_in(bench.people.get(role))
    entered = []
    for path in admin_paths(bench):
        answer = client.get(path)
        if role == "anonymous" and path.startswith(("/admin/jsi18n", "/admin/logout")):
            continue
        closed = answer.status_code in {302, 404} if role == "anonymous" else False
        if not (closed or answer.status_code in {403, 404, 405}):
            entered.append((path, answer.status_code))
    assert not entered


def test_an_admin_sees_every_list(bench: Bench) -> None:
    an_edge(bench).work_off(a_started_run(bench))
    client = signed_in(bench.people["admin"])
    lists = [r for r, v in routes() if r.startswith("admin/") and r.count("/") == 3]
    assert len(lists) > 20
    for path in lists:
        assert client.get(f"/{path}").status_code == 200, path
