"""Every URL of the server by every role; a URL that is not in the tables fails."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast
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
from tests.builders import PASSWORD, Bench, a_started_run, an_edge
from tests.labweb.enrollment.driver_texts import TIMER, timer
from tests.labweb.instrument_files import TRACE
from tests.labweb.photos import a_photo
from tests.labweb.security.things import one_of_each
from tests.labweb.web import call, routes, signed_in
from tests.labweb.web import code_of as error_code_of

EVERY = ("anonymous", "observer", "chemist", "approver", "admin")
MEMBERS = EVERY[1:]
WORKERS = EVERY[2:]
DECIDERS = EVERY[3:]
ADMINS = EVERY[4:]


class Form(dict[str, str]):
    """Fields of a form that brings a file."""


A_VIAL = {
    "operation": {
        "op": "create",
        "resource_id": "0198a000-0000-7000-8000-000000000001",
        "parent_id": "<place>",
        "key": "vial",
        "name": "Vial",
        "kind": "vial",
    }
}

A_CALIBRATION = {
    "source_id": "<resource>",
    "target_id": "<pan>",
    "balance_id": "<balance>",
    "around": {"water_c": 22, "pressure_kpa": 101.3},
    "reference": {
        "name": "Balance 1",
        "certificate": "D-K-1",
        "expanded": 0.4,
        "due_on": "2099-01-01",
    },
}

A_CALIBRATION_OF_PH = {
    "buffers": [
        {"source_id": vessel, "standard": standard, "reference": A_CALIBRATION["reference"]}
        for vessel, standard in (("<resource>", "phosphate"), ("<acid>", "phthalate"))
    ],
    "vessel_id": "<dipped>",
    "waste_id": "<waste>",
    "pump_id": "<calibrated>",
    "volume_ul": 5000,
}

A_CALIBRATION_OF_TEMPERATURE = {
    "vessel_id": "<dipped>",
    "thermometer_id": "<probe>",
    "reference": A_CALIBRATION["reference"],
    "set_points_c": [30, 40, 50],
}

A_RECIPE = base64.b64encode(
    b"<XDL><Synthesis><Hardware/><Reagents/>"
    b'<Procedure><Wait time="1 s"/></Procedure></Synthesis></XDL>'
).decode()

API: dict[tuple[str, str], tuple[tuple[str, ...], Any]] = {
    ("GET", "session"): (EVERY, None),
    ("POST", "session"): (EVERY, {"username": "observer", "password": PASSWORD}),
    ("DELETE", "session"): (EVERY, None),
    ("POST", "session/password"): (MEMBERS, {"old": PASSWORD, "new": "another-long-passphrase"}),
    ("POST", "session/confirm"): (MEMBERS, {"password": PASSWORD}),
    ("POST", "session/awake"): (MEMBERS, None),
    ("GET", "home"): (MEMBERS, None),
    ("GET", "search"): (MEMBERS, None),
    ("GET", "devices"): (MEMBERS, None),
    ("GET", "devices/<device>"): (MEMBERS, None),
    ("GET", "devices/<device>/telemetry"): (MEMBERS, None),
    ("GET", "devices/<device>/telemetry/curves"): (MEMBERS, None),
    ("GET", "devices/<device>/telemetry/export"): (MEMBERS, None),
    ("POST", "devices/<device>/driver"): (
        ADMINS,
        {"version_id": "<approved>", "reason": "better"},
    ),
    ("GET", "devices/<device>/driver/<approved>/parts"): (ADMINS, None),
    ("POST", "devices/<showing>/show"): (WORKERS, {}),
    ("POST", "devices/<stopped>/stop"): (MEMBERS, {}),
    ("GET", "devices/<device>/photo"): (MEMBERS, None),
    ("POST", "devices/<device>/photo"): (ADMINS, Form()),
    ("GET", "drivers"): (MEMBERS, None),
    ("POST", "drivers"): (ADMINS, {"module": TIMER, "source": timer(9)}),
    ("POST", "drivers/reading"): (ADMINS, {"module": TIMER, "source": timer(9)}),
    ("GET", "drivers/<driver>"): (MEMBERS, None),
    ("GET", "drivers/<driver>/changes/<since>"): (DECIDERS, None),
    ("POST", "drivers/<driver>/decision"): (DECIDERS, {"is_approved": True}),
    ("POST", "drivers/<approved>/devices"): (
        ADMINS,
        {"devices": [{"device_id": "<device>"}], "reason": "better"},
    ),
    ("POST", "drivers/<driver>/withdraw"): (ADMINS, {"reason": "old"}),
    ("GET", "drivers/<driver>/tryouts"): (MEMBERS, None),
    ("POST", "drivers/<driver>/tryouts"): (ADMINS, {"host_id": "<host>", "model": "timer"}),
    ("GET", "tryouts/<tryout>"): (MEMBERS, None),
    ("POST", "tryouts/<tryout>/wishes"): (ADMINS, {"sort": "read"}),
    ("GET", "hosts"): (MEMBERS, None),
    ("GET", "hosts/<host>"): (MEMBERS, None),
    ("POST", "hosts/<host>/fence"): (ADMINS, {"reason": "it burnt"}),
    ("POST", "hosts/<host>/readmit"): (ADMINS, {"reason": "looked"}),
    ("POST", "hosts/<host>/revoke"): (ADMINS, {"reason": "stolen"}),
    ("GET", "tokens"): (MEMBERS, None),
    ("POST", "tokens"): (MEMBERS, {"name": "script", "scope": "read", "days": 30}),
    ("DELETE", "tokens/<access>"): (ADMINS, None),
    ("GET", "join-tokens"): (ADMINS, None),
    ("POST", "join-tokens"): (ADMINS, {"name": "Bench 9"}),
    ("DELETE", "join-tokens/<token>"): (ADMINS, None),
    ("GET", "join-requests"): (ADMINS, None),
    ("POST", "join-requests/<join>/admit"): (ADMINS, {"code": "<code>", "reason": "stood there"}),
    ("POST", "join-requests/<join>/reject"): (ADMINS, {"reason": "unknown"}),
    ("POST", "resources/<resource>/handover"): (WORKERS, {"place_id": "<place>", "note": "moved"}),
    ("POST", "handovers/<custody>/arrived"): (WORKERS, {}),
    ("GET", "twin"): (MEMBERS, None),
    # Open to who signs the request with the shared secret, whoever is signed in.
    ("POST", "deliveries"): ((), {"lots": []}),
    ("GET", "connections"): (MEMBERS, None),
    ("GET", "resources"): (MEMBERS, None),
    ("GET", "resources/contents"): (MEMBERS, None),
    ("GET", "lab/export"): (MEMBERS, None),
    ("GET", "lots/export"): (MEMBERS, None),
    ("GET", "resources/<resource>"): (MEMBERS, None),
    ("GET", "resources/<resource>/events"): (MEMBERS, None),
    ("GET", "resources/<resource>/lineage"): (MEMBERS, None),
    ("GET", "resources/<resource>/provenance"): (MEMBERS, None),
    ("GET", "resources/<resource>/custody"): (MEMBERS, None),
    ("GET", "resources/<resource>/stock"): (MEMBERS, None),
    ("GET", "devices/<calibrated>/calibrations"): (MEMBERS, None),
    ("POST", "devices/<calibrated>/calibrations"): (WORKERS, A_CALIBRATION),
    ("POST", "devices/<probe>/calibrations/ph"): (WORKERS, A_CALIBRATION_OF_PH),
    ("POST", "devices/<heating>/calibrations/temperature"): (WORKERS, A_CALIBRATION_OF_TEMPERATURE),
    ("GET", "calibrations/<calibration>"): (MEMBERS, None),
    ("POST", "calibrations/<calibration>/decision"): (DECIDERS, {"is_accepted": True}),
    ("POST", "calibrations/<calibration>/withdraw"): (DECIDERS, {"reason": "a new syringe"}),
    ("GET", "resources/<resource>/reservations"): (MEMBERS, None),
    ("GET", "reservations"): (MEMBERS, None),
    ("POST", "reservations"): (
        WORKERS,
        {"resource_ids": ["<place>"], "minutes": 30, "reason": "a wash"},
    ),
    # The chemist's own, and approvers may end it too.
    ("POST", "reservations/<reservation>/end"): (WORKERS, {}),
    ("GET", "resources/<resource>/reaction"): (MEMBERS, None),
    ("GET", "tickets/<ticket>"): (MEMBERS, None),
    ("POST", "tickets/<ticket>/close"): (WORKERS, {"reason": "looked"}),
    ("GET", "resources/<resource>/conditions?device=<device>"): (MEMBERS, None),
    ("GET", "lots/<lot>/provenance"): (MEMBERS, None),
    ("POST", "operations"): (WORKERS, A_VIAL),
    ("POST", "operations/check"): (WORKERS, A_VIAL),
    ("GET", "steps"): (MEMBERS, None),
    ("GET", "lab"): (MEMBERS, None),
    ("POST", "lab/stop"): (MEMBERS, None),
    ("POST", "lab/reset"): (DECIDERS, {"reason": "looked"}),
    ("GET", "workflows"): (MEMBERS, None),
    ("POST", "workflows"): (WORKERS, {"name": "Mine"}),
    ("POST", "workflows/check"): (MEMBERS, {"document": {}}),
    ("GET", "workflows/<workflow>"): (MEMBERS, None),
    ("PUT", "workflows/<workflow>/draft"): (WORKERS, {"document": {"steps": []}, "revision": 1}),
    ("GET", "workflows/<workflow>/versions"): (MEMBERS, None),
    ("POST", "workflows/<workflow>/versions"): (WORKERS, {}),
    ("GET", "workflows/<workflow>/versions/<number>"): (MEMBERS, None),
    ("POST", "recipes/open"): (WORKERS, {"name": "a", "recipe": A_RECIPE}),
    ("POST", "recipes/advise"): (WORKERS, {"name": "a", "recipe": A_RECIPE}),
    ("POST", "recipes/keep"): (WORKERS, {"name": "Mine", "recipe": A_RECIPE}),
    ("GET", "runs"): (MEMBERS, None),
    ("POST", "runs"): (WORKERS, {"version_id": "<version>"}),
    ("GET", "runs/<run>"): (MEMBERS, None),
    ("GET", "runs/<run>/events"): (MEMBERS, None),
    ("GET", "runs/<run>/log"): (MEMBERS, None),
    ("GET", "runs/<run>/provenance"): (MEMBERS, None),
    ("GET", "runs/<run>/report"): (MEMBERS, None),
    ("GET", "runs/<run>/crate"): (MEMBERS, None),
    ("GET", "runs/<run>/eln"): (MEMBERS, None),
    ("GET", "files"): (MEMBERS, None),
    ("POST", "files"): (WORKERS, Form({"resource": "<resource>", "format": "csv"})),
    ("GET", "files/incoming"): (MEMBERS, None),
    ("GET", "files/incoming/<incoming>"): (MEMBERS, None),
    ("GET", "files/<file>"): (MEMBERS, None),
    ("GET", "files/<file>/content"): (MEMBERS, None),
    ("GET", "files/<file>/provenance"): (MEMBERS, None),
    ("GET", "readings"): (MEMBERS, None),
    ("GET", "readings/<reading>/provenance"): (MEMBERS, None),
    ("GET", "readings/<reading>/points"): (MEMBERS, None),
    ("POST", "runs/<run>/pause"): (WORKERS, {}),
    ("POST", "runs/<run>/resume"): (WORKERS, {}),
    ("POST", "runs/<run>/abort"): (WORKERS, {"reason": "enough"}),
    ("POST", "jobs/<job>/confirm"): (WORKERS, {}),
    ("POST", "jobs/<job>/recover"): (WORKERS, {"choice": "retry", "note": "freed"}),
    ("POST", "jobs/<job>/resolve"): (WORKERS, {"answer": "did_not", "note": "dry"}),
    ("GET", "approvals"): (MEMBERS, None),
    ("GET", "approvals/<request>"): (MEMBERS, None),
    ("POST", "approvals/<request>/decision"): (DECIDERS, {"is_approved": True}),
}
"""Method and route → who may, and a body that would be right."""

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
