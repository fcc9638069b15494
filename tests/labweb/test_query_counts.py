"""How many queries a page costs, and the way from a click to a host; frozen in query_counts.json.

A change that needs more says so by changing the file in the same commit.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from django.db import connection
from django.test.utils import CaptureQueriesContext

from labweb.runs import services
from tests.builders import HEAT, MOVE_WATER, Bench, a_started_run, an_edge
from tests.labweb.web import call, read, signed_in

COUNTS: dict[str, int] = json.loads(Path(__file__).with_name("query_counts.json").read_text())
PATHS = {
    "home": "/api/v1/home",
    "resources": "/api/v1/resources",
    "devices": "/api/v1/devices",
    "runs": "/api/v1/runs",
    "run": "/api/v1/runs/{run}",
    "run events": "/api/v1/runs/{run}/events",
    "resource": "/api/v1/resources/{water}",
    "approvals": "/api/v1/approvals",
    "admin events": "/admin/crutd/event/",
    "admin devices": "/admin/enrollment/device/",
}


ACTS = {"start", "dispatch", "relay"}
"""From a click on *Start* to its answer; from there to the outbox, and to the host's door."""


def count(bench: Bench, place: str, run: object) -> int:
    client = signed_in(bench.people["admin"])
    path = PATHS[place].format(run=run, water=bench.node("water").id)
    client.get(path)
    with CaptureQueriesContext(
        connection,
    ) as queries:
        if place.startswith("admin"):
            assert client.get(path).status_code == 200
        else:
            read(client, path)
    return len(queries)


def test_every_page_has_its_number() -> None:
    assert set(COUNTS) == {*PATHS, *ACTS}


def test_a_click_costs_what_it_cost_before(bench: Bench) -> None:
    an_edge(bench)
    client = signed_in(bench.people["chemist"])
    wanted = {"version_id": str(bench.version(MOVE_WATER).id)}
    services.preview(
        bench.lab, bench.version(MOVE_WATER).document
    )  # reads the drivers, as any has done
    with CaptureQueriesContext(connection) as starting:
        assert call(client, "POST", "/api/v1/runs", wanted).status_code == 201
    with CaptureQueriesContext(connection) as dispatching:
        assert services.dispatch_ready() == 1
    with CaptureQueriesContext(connection) as relaying:
        assert services.publish_outbox() == 1
    told = {"start": len(starting), "dispatch": len(dispatching), "relay": len(relaying)}
    assert told == {name: COUNTS[name] for name in ACTS}


@pytest.mark.parametrize("place", PATHS)
def test_a_page_costs_what_it_cost_before(bench: Bench, place: str) -> None:
    run = a_started_run(bench)
    an_edge(bench).work_off(run)
    a_started_run(bench, HEAT)
    assert count(bench, place, run.id) == COUNTS[place]


@pytest.mark.parametrize("place", ["home", "runs", "approvals", "admin events"])
def test_more_rows_cost_no_more_queries(bench: Bench, place: str) -> None:
    run = a_started_run(bench)
    a_started_run(bench, HEAT)
    before = count(bench, place, run.id)
    for _ in range(3):
        a_started_run(bench, HEAT, actor="approver")
    assert count(bench, place, run.id) == before
