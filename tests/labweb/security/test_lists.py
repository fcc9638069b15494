"""Every list goes on behind its limit, and every address says what it takes."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import urlencode
from uuid import UUID, uuid4

import pytest
from django.db.models import Model
from django.test import Client
from pytest_django import Settings

from labweb.accounts import services as account_services
from labweb.accounts.api import Endpoint
from labweb.accounts.models import AccessToken
from labweb.approvals.models import ApprovalRequest, Tryout
from labweb.calibration.models import Calibration
from labweb.crutd import services as crutd_services
from labweb.crutd.models import Event, EventHead, ResourceReservation
from labweb.domain.approvals.access_tokens import AccessScope
from labweb.domain.crutd.operations import TransferLiquid
from labweb.enrollment.models import Device, DriverVersion, EdgeHost, JoinToken
from labweb.resources.models import Connection, Resource
from labweb.runs.models import HostEvent, Run
from labweb.telemetry.models import File, Incoming, Reading
from labweb.workflows.models import Workflow, WorkflowVersion
from tests.builders import Bench
from tests.labweb.security.rest_table import API
from tests.labweb.security.test_matrix import name_of
from tests.labweb.security.things import a_machine_that_asks, one_of_each
from tests.labweb.web import call, code_of, read, routes, signed_in

VIEWS: dict[str, type[Endpoint]] = {
    name_of(route): view.cls for route, view in routes() if route.startswith("api/v1/")
}
READ = sorted({route.split("?")[0] for method, route in API if method == "GET"})
LISTS = sorted(route for route in READ if "limit" in VIEWS[route].queries)

_numbers = count(1000)


def another(row: Model | None, **changes: Any) -> None:  # noqa: ANN401 - columns of any sort
    """Put a copy of a row into its table, at the same time, with its own id and key."""
    assert row is not None
    new, number = copy.copy(row), next(_numbers)
    new._state = copy.copy(row._state)
    new._state.adding = True
    new.pk = uuid4() if isinstance(row.pk, UUID) else None
    for name in ("number", "index"):
        if hasattr(row, name):
            setattr(new, name, number)
    if hasattr(row, "key"):
        new.key = f"another-{number}"  # type: ignore[attr-defined]
    for name, value in changes.items():
        setattr(new, name, value)
    new.save(force_insert=True)


def _event_of(bench: Bench, ids: dict[str, str]) -> None:
    jobs = bench.lab.runs.get(pk=ids["run"]).jobs.values("id")
    head = EventHead.objects.get(lab=bench.lab)
    row = Event.objects.filter(transaction__job_id__in=jobs).first()
    another(row, seq=head.seq + 1, prev_hash=head.hash, hash=uuid4().hex * 2)


def _host_event(bench: Bench, ids: dict[str, str]) -> None:
    jobs = bench.lab.runs.get(pk=ids["run"]).jobs.values("attempts__id")
    row = HostEvent.objects.filter(action_id__in=jobs).first()
    number = next(_numbers) + 10_000
    another(row, seq=number, hash=uuid4().hex * 2, body={"pid": number})


def _poured(bench: Bench, ids: dict[str, str]) -> None:
    acid, target = UUID(ids["acid"]), UUID(ids["dipped"])
    poured = TransferLiquid(source_id=acid, target_id=target, amount_nl=1000)
    crutd_services.carry_out(poured, lab=bench.lab, actor_id=bench.people["chemist"].pk)


def _copied(model: type[Model], name: str = "", **made: Any) -> Callable[..., None]:  # noqa: ANN401
    """Say that the thing of this name is copied; without a name, the first of its table."""

    def add(bench: Bench, ids: dict[str, str]) -> None:
        del bench
        rows = model._default_manager.order_by("pk")
        row = rows.get(pk=ids[name]) if name else rows.first()
        another(row, **{column: make() for column, make in made.items()})

    return add


def _calibrated_again(bench: Bench, ids: dict[str, str]) -> None:
    another(Run.objects.get(pk=ids["run"]))
    another(
        Calibration.objects.get(pk=ids["calibration"]), run=bench.lab.runs.first(), state="failed"
    )


def a_token_of_admin(bench: Bench) -> None:
    admin = bench.people["admin"]
    row, _ = account_services.make_token(
        admin, lab_id=bench.lab.pk, name=uuid4().hex, scope=AccessScope.READ, days=1
    )
    AccessToken.objects.filter(pk=row.pk).update(revoked_at=row.created_at)


def _bytes() -> str:
    return uuid4().hex * 2


ADD: dict[str, Callable[[Bench, dict[str, str]], None]] = {
    "approvals": _copied(ApprovalRequest, "request"),
    "connections": _copied(Connection),
    "devices": _copied(Device, "device"),
    "devices/<calibrated>/calibrations": _calibrated_again,
    "drivers": _copied(DriverVersion, "driver", digest=_bytes),
    "drivers/<driver>/tryouts": _copied(Tryout, "tryout"),
    "files": _copied(File, "file", sha256=_bytes),
    "files/incoming": _copied(Incoming, "incoming", sha256=_bytes),
    "hosts": _copied(EdgeHost, "host"),
    "join-requests": lambda bench, _: void(a_machine_that_asks(bench)),
    "join-tokens": _copied(JoinToken, "token"),
    "readings": _copied(Reading, "reading"),
    "reservations": _copied(ResourceReservation, "reservation"),
    "resources": _copied(Resource, "resource"),
    "resources/<resource>/events": _poured,
    "resources/<resource>/reservations": _copied(ResourceReservation, "reservation"),
    "runs": _copied(Run, "run"),
    "runs/<run>/events": _event_of,
    "runs/<run>/log": _host_event,
    "tokens": lambda bench, _: a_token_of_admin(bench),
    "workflows": _copied(Workflow, "workflow"),
    "workflows/<workflow>/versions": _copied(WorkflowVersion, "version"),
}
"""Each list, and how a row comes into it."""


IN_PLACE = {
    "resources/<resource>/reservations": "resources/<reserved>/reservations",
    "resources/<resource>/events": "resources/<acid>/events",
}
"""Where the named resource can have no more rows."""


def void(_: object) -> None:
    """Leave a value."""


@pytest.fixture
def ids(bench: Bench, settings: Settings, tmp_path: Path) -> dict[str, str]:
    settings.DATA_DIR = tmp_path
    made = one_of_each(bench)
    reserved = ResourceReservation.objects.get(pk=made["reservation"]).resource_id
    device = Calibration.objects.get(pk=made["calibration"]).device_id
    version = WorkflowVersion.objects.get(workflow_id=made["workflow"]).id
    others: dict[str, str] = {
        "reserved": str(reserved),
        "calibrated": str(device),
        "version": str(version),
    }
    return {**made, **others}


def path_of(route: str, ids: dict[str, str]) -> str:
    route = IN_PLACE.get(route, route)
    return "/api/v1/" + re.sub(r"<(\w+)>", lambda found: ids[found[1]], route)


def rows_in(route: str, answer: dict[str, Any]) -> list[str]:
    """Return the rows of a list, each as one text, in their order."""
    if "quantities" in answer:
        rows = [row for one in answer["quantities"] for row in one["history"]]
    else:
        lists = {name: value for name, value in answer.items() if isinstance(value, list)}
        rows = lists.get(route.rsplit("/", 1)[-1]) or next(iter(lists.values()))
    keys = ("id", "seq", "transaction_id")
    return [
        json.dumps({key: row[key] for key in keys if key in row} if "lines" not in answer else row)
        for row in rows
    ]


def pages(
    client: Client, route: str, ids: dict[str, str], limit: int, between: Callable[[], None]
) -> Iterator[list[str]]:
    """Read a list to its end, and let something happen behind each page."""
    path, after = path_of(route, ids), ""
    while True:
        answer = read(client, f"{path}?limit={limit}{after}")
        yield rows_in(route, answer)
        if answer["next"] is None:
            return
        after = f"&{urlencode({'after': answer['next']})}"
        between()


def test_every_list_that_grows_has_its_row_here() -> None:
    assert set(ADD) == set(LISTS)


@pytest.mark.parametrize("route", sorted(ADD))
def test_a_list_goes_on_behind_its_limit_without_loss_or_doubling(
    bench: Bench, ids: dict[str, str], route: str
) -> None:
    client = signed_in(bench.people["admin"])

    def add() -> None:
        ADD[route](bench, ids)

    for _ in range(5):
        add()
    at_first = rows_in(route, read(client, path_of(route, ids)))
    assert len(at_first) == len(set(at_first)) >= 5
    added = iter(range(6))

    def add_few() -> None:
        if next(added, None) is not None:
            add()

    found = []
    for page in pages(client, route, ids, 2, add_few):
        assert 0 < len(page) <= 2
        found += page
    assert len(found) == len(set(found))
    assert [row for row in found if row in set(at_first)] == at_first


@pytest.mark.parametrize("route", ["runs", "devices"])
@pytest.mark.parametrize(
    "after",
    ["", "x", "bm90IGpzb24", "W10", "WyJrZXkiXQ", "WyJrZXkiLDEsMl0", "WyJrZXkiLFsxXV0",
     "WyItbnVtYmVyIiwieCJd", "WyItbnVtYmVyIiwxZTQwMF0",
     "WyItbnVtYmVyIiw5OTk5OTk5OTk5OTk5OTk5OTk5OV0",
     "x" * 5000],
)  # fmt: skip
def test_what_is_no_page_of_a_list_is_refused(bench: Bench, route: str, after: str) -> None:
    client = signed_in(bench.people["admin"])
    answer = client.get(f"/api/v1/{route}?{urlencode({'after': after})}")
    assert (answer.status_code, code_of(answer)) == (422, "http.query")


def test_the_place_in_one_list_is_none_in_another(bench: Bench, ids: dict[str, str]) -> None:
    client = signed_in(bench.people["admin"])
    _poured(bench, ids)
    _poured(bench, ids)
    events = read(client, path_of("resources/<resource>/events", ids) + "?limit=1")
    answer = client.get(f"/api/v1/runs?{urlencode({'after': events['next']})}")
    assert (answer.status_code, code_of(answer)) == (422, "http.query")


def test_more_rows_than_a_list_gives_are_refused_with_the_most(
    bench: Bench, ids: dict[str, str]
) -> None:
    client = signed_in(bench.people["admin"])
    for route in LISTS:
        most = VIEWS[route].queries["limit"].schema["maximum"]
        answer = client.get(f"{path_of(route, ids)}?limit={most + 1}")
        assert (answer.status_code, code_of(answer)) == (422, "http.query"), route
        assert str(most) in json.loads(answer.content)["message"]


def test_every_address_refuses_a_parameter_that_it_does_not_have(
    bench: Bench, ids: dict[str, str]
) -> None:
    wrong = []
    for (method, route), (roles, _) in API.items():
        if not roles:
            continue  # nobody comes in by a session
        client = signed_in(bench.people["admin"])
        answer = call(client, method, path_of(route.split("?")[0], ids) + "?before=1", {})
        told = json.loads(answer.content)
        names = VIEWS[route.split("?")[0]].queries if method == "GET" else {}
        is_named = all(name in told["message"] for name in names)
        if (answer.status_code, told["code"], is_named) != (400, "http.unknown_parameter", True):
            wrong.append((method, route, answer.status_code, told))
    assert not wrong


BAD = (
    "9" * 316, "1e400", "-1e400", "NaN", "Infinity", "-Infinity", "-0",
    str(2**63), str(-(2**63) - 1),
    "²", "a\x00b", "", "x" * 3000,
)  # fmt: skip


def test_no_value_of_a_parameter_makes_the_server_fail(bench: Bench, ids: dict[str, str]) -> None:
    client, wrong = signed_in(bench.people["admin"]), []
    for route in READ:
        for name in VIEWS[route].queries:
            for value in BAD:
                path = f"{path_of(route, ids)}?{urlencode({name: value})}"
                answer = call(client, "GET", path)
                if answer.status_code >= 500:
                    wrong.append((route, name, value[:20], answer.status_code))
    assert not wrong


def test_the_schema_names_what_each_address_takes(bench: Bench) -> None:
    schema = json.loads(signed_in(bench.people["admin"]).get("/api/schema/?format=json").content)
    told = {
        path.removeprefix("/api/v1/"): {
            one["name"] for one in operations["get"].get("parameters", ()) if one["in"] == "query"
        }
        for path, operations in schema["paths"].items()
        if "get" in operations
    }
    plain = {re.sub(r"\{.*?\}", "{}", path): names for path, names in told.items()}
    assert plain == {re.sub(r"<.*?>", "{}", route): set(VIEWS[route].queries) for route in READ}


def test_a_state_of_runs_that_there_is_not_is_refused_with_those_that_there_are(
    bench: Bench,
) -> None:
    told = read(signed_in(bench.people["observer"]), "/api/v1/runs?state=running,foo", status=422)
    assert told["code"] == "http.query"
    assert told["message"] == (
        "there is no state 'foo' of runs; state lists some of draft, awaiting_approval, queued, "
        "running, pausing, paused, completing, complete, aborted, with commas between"
    )
