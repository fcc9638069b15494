"""What one may not see is not there, and who may not act is told so before anything else.

```text
lab ─┬─ bench_1, …   all that the tables name
     └─ annex        the guest's subtree, which is empty
```
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast
from uuid import uuid4

import pytest
from django.core.files.uploadedfile import SimpleUploadedFile
from django.db.transaction import atomic, set_rollback
from django.http import HttpResponse
from django.test import Client
from pytest_django import Settings

from labweb.accounts.selectors import User
from labweb.approvals.models import ApprovalRequest, Tryout
from labweb.calibration.models import Calibration
from labweb.common.clock import now
from labweb.crutd.models import Ticket
from labweb.enrollment.models import Device, DriverVersion, EdgeHost, JoinRequest, JoinToken
from labweb.resources.models import Resource
from labweb.runs import services as run_services
from labweb.runs.models import Custody, Run
from labweb.workflows.models import Workflow
from tests.builders import Bench, a_started_run, a_user
from tests.labweb.instrument_files import TRACE
from tests.labweb.photos import a_photo
from tests.labweb.security.rest_table import API, MEMBERS, Form
from tests.labweb.security.test_matrix import prepare
from tests.labweb.security.things import one_of_each
from tests.labweb.web import call, signed_in

CLOSED_TO = ("join-tokens/", "join-requests/", "tokens/")
CLOSED = {route for _, route in API if route.startswith(CLOSED_TO)}
"""What only who admits hosts, or the owner of a token, may touch: anybody else is refused alike."""

DRIVERS = {"driver", "approved", "since", "tryout"}
"""What who gives drivers to the devices of any part of the lab has to choose from."""

THINGS = {"place", "resource", "pan", "balance", "acid", "dipped", "waste", "calibrated", "probe"}

_PLACE = re.compile(r"<(\w+)>")


@pytest.fixture
def ids(bench: Bench, settings: Settings, tmp_path: Path) -> dict[str, str]:
    settings.DATA_DIR = tmp_path
    found = one_of_each(bench)
    version = bench.version("Move 5 mL of water")
    return {**found, "workflow": str(version.workflow_id), "number": str(version.number)}


def a_guest(bench: Bench, *roles: str) -> User:
    annex = Resource.objects.create(
        id=uuid4(),
        lab=bench.lab,
        key="annex",
        name="Annex",
        kind="bench",
        nature="resource",
        parent=bench.node("lab"),
    )
    return [a_user(role, on=annex, name="guest") for role in roles][-1]


def named(method: str, route: str) -> list[str]:
    """List what a request names by id: in its address, or else in its body."""
    body = API[method, route][1]
    found = _PLACE.findall(route) or _PLACE.findall(json.dumps(body) if body else "")
    return [name for name in found if name not in {"number", "code"}]


def request(client: Client, method: str, route: str, ids: dict[str, str]) -> HttpResponse:
    """Send what is right but for the ids."""
    path = "/api/v1/" + _PLACE.sub(lambda found: ids[found[1]], route)
    told = API[method, route][1]
    body = json.loads(re.sub(r'"<(\w+)>"', lambda found: f'"{ids[found[1]]}"', json.dumps(told)))
    if not isinstance(told, Form):
        return call(client, method, path, body)
    data = a_photo("blue") if route.endswith("photo") else TRACE.encode()
    file = SimpleUploadedFile("b.csv", data)
    return cast("HttpResponse", client.post(path, {**body, "file": file}))


def told(answer: HttpResponse, ids: dict[str, str]) -> tuple[int, str]:
    """Return status and body, with the ids of the request called by name."""
    text = answer.content.decode()
    for name, one in ids.items():
        if name != "number":
            text = text.replace(one, f"<{name}>")
    return answer.status_code, text


@pytest.mark.parametrize("roles", [("observer",), ("chemist", "approver", "admin")])
def test_what_one_may_not_see_is_answered_as_what_is_not_there(
    bench: Bench, ids: dict[str, str], roles: tuple[str, ...]
) -> None:
    client = signed_in(a_guest(bench, *roles))
    wrong: list[Any] = []
    for method, route in API:
        names = named(method, route)
        if not names or (set(names) <= DRIVERS and "admin" in roles):
            continue
        none = {**ids, **{name: str(uuid4()) for name in names}}
        with atomic():
            expected = told(request(client, method, route, none), {n: none[n] for n in names})
            set_rollback(True)
        if expected[0] != (403 if route in CLOSED else 404):
            wrong.append((method, route, expected))
        for is_prepared in (False, True):
            with atomic():
                if is_prepared:
                    prepare(bench, route, ids)
                found = told(request(client, method, route, ids), {n: ids[n] for n in names})
                set_rollback(True)
            if found != expected:
                wrong.append((method, route, is_prepared, found, expected))
    assert not wrong, "\n".join(map(str, wrong))


@pytest.mark.parametrize("kind", ["vial", "balance", "bench"])
def test_what_one_may_not_see_is_not_there_for_an_act_on_what_one_sees(
    bench: Bench, ids: dict[str, str], kind: str
) -> None:
    client = signed_in(a_guest(bench, "observer"))
    for role in ("chemist", "approver", "admin"):
        a_user(role, on=bench.node("bench_1"), name="guest")
    hidden = Resource.objects.create(
        id=uuid4(),
        lab=bench.lab,
        key="hidden",
        name="Hidden",
        kind=kind,
        nature="resource",
        parent=bench.node("lab"),
    )
    wrong: list[Any] = []
    for method, route in API:
        others = set(_PLACE.findall(json.dumps(API[method, route][1]))) & THINGS
        for name in others if "<" in route else ():
            found = []
            for one in (hidden.id, uuid4()):
                with atomic():
                    prepare(bench, route, ids)
                    changed = {**ids, name: str(one)}
                    answer = request(client, method, route, changed)
                    found.append(told(answer, {name: str(one)}))
                    set_rollback(True)
            if found[0] != found[1] or found[0][0] != 404:
                wrong.append((method, route, name, *found))
    assert not wrong, "\n".join(map(str, wrong))


def everything_is_over(bench: Bench) -> None:
    """Bring all there is into a state in which nothing can be done with it any more."""
    at = now()
    Run.objects.update(state="aborted", ended_at=at)
    ApprovalRequest.objects.update(state="rejected")
    Calibration.objects.update(state="withdrawn")
    Ticket.objects.update(closed_at=at)
    EdgeHost.objects.update(state="revoked")
    Device.objects.update(state="retired")
    DriverVersion.objects.update(state="withdrawn")
    Tryout.objects.update(state="ended", ended_at=at)
    Custody.objects.update(state="settled", ended_at=at)
    JoinRequest.objects.update(state="rejected")
    JoinToken.objects.update(withdrawn_at=at)
    Workflow.objects.update(draft_revision=7)


NEVER_OVER = {
    "devices/<device>/photo",
    "reservations/<reservation>/end",
    "tokens/<access>",
    "workflows/<workflow>/versions",
}
"""What nothing about the thing itself forbids."""


def the_lab_is_stopped(bench: Bench) -> None:
    run_services.stop_lab(actor=bench.people["chemist"])


def a_run_has_not_begun(bench: Bench) -> None:
    a_started_run(bench)


@pytest.mark.parametrize("spoil", [everything_is_over, the_lab_is_stopped, a_run_has_not_begun])
def test_who_may_not_act_is_told_so_whatever_the_state(
    bench: Bench, ids: dict[str, str], spoil: Callable[[Bench], None]
) -> None:
    spoil(bench)
    wrong: list[Any] = []
    tried, refused = set[str](), set[str]()
    for (method, route), (allowed, _) in API.items():
        others = [role for role in MEMBERS if role not in allowed]
        if method == "GET" or not allowed or not others:
            continue
        tried.add(route)
        for role in [allowed[0], *others]:
            with atomic():
                answer = request(signed_in(bench.people[role]), method, route, ids)
                set_rollback(True)
            if role in allowed and answer.status_code != 403 and answer.status_code > 399:
                refused.add(route)
            if role not in allowed and answer.status_code != 403:
                wrong.append((role, method, route, answer.status_code, answer.content[:300]))
    assert not wrong, "\n".join(map(str, wrong))
    by_id = {route for route in tried if "<" in route}
    assert "runs" in refused
    assert spoil is not everything_is_over or by_id - refused == NEVER_OVER
