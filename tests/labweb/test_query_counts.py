"""How many queries a page costs; the numbers are frozen in query_counts.json.

A change that needs more says so by changing the file in the same commit.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from django.db import connection
from django.test.utils import CaptureQueriesContext

from tests.builders import HEAT, Bench, a_started_run, an_edge
from tests.labweb.web import read, signed_in

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
    assert set(COUNTS) == set(PATHS)


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
