"""Lists that go on: how many rows are shown, and the way to more; and a choice without room."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Route, expect

from tests.e2e.conftest import Visit
from tests.e2e.pictures import shoot
from tests.e2e.test_wishes import HEAT, give_up
from tests.e2e.visitor import Visitor
from tests.system.stack import Stack

FEW = 2


def short_pages(visitor: Visitor) -> None:
    """Ask the server for pages of two rows, so that a short list goes on, too."""

    def few(route: Route) -> None:
        route.continue_(url=re.sub(r"limit=\d+", f"limit={FEW}", route.request.url))

    visitor.page.route(re.compile(r"/api/v1/.*limit=\d+"), few)


@pytest.fixture
def waiting(stack: Stack) -> Iterator[int]:
    """Five runs that wait for an answer, started one after the other."""
    for _ in range(5):
        stack.client().start(HEAT)
    yield 5
    give_up(stack)


def test_a_list_of_runs_is_shown_further_when_asked(visit: Visit, waiting: int) -> None:
    observer = visit("observer")
    short_pages(observer)
    observer.open("runs?state=awaiting_approval")
    rows = observer.at("run-row")
    expect(rows).to_have_count(FEW)
    expect(observer.at("more")).to_contain_text("The newest 2 runs are shown.")
    shoot(observer, "list-runs-more")
    observer.press("show-more")
    expect(rows).to_have_count(2 * FEW)
    while observer.at("show-more").count():
        before = rows.count()
        observer.press("show-more")
        expect(rows).not_to_have_count(before)
    numbers = [text.split()[0] for text in rows.all_inner_texts()]
    assert len(numbers) == len(set(numbers)) >= waiting
    assert not observer.complaints


def test_a_list_of_requests_is_shown_further_when_asked(visit: Visit, waiting: int) -> None:
    approver = visit("approver")
    short_pages(approver)
    approver.open("approvals")
    expect(approver.at("approval-row")).to_have_count(FEW)
    shoot(approver, "list-approvals-more")
    approver.press("show-more")
    expect(approver.at("approval-row")).to_have_count(min(2 * FEW, waiting))


def test_events_of_a_vessel_are_shown_further_when_asked(visit: Visit, stack: Stack) -> None:
    client = stack.client()
    acid = next(row for row in client.get("resources")["resources"] if row["key"] == "acid")
    target = next(row for row in client.get("resources")["resources"] if row["key"] == "waste")
    for _ in range(2 * FEW + 1):
        operation = {"op": "transfer_liquid", "source_id": acid["id"], "target_id": target["id"]}
        body = {"operation": {**operation, "amount_nl": 1000}, "note": "a drop"}
        client.call("POST", "operations", body)
    observer = visit("observer")
    whole = re.compile(rf"/api/v1/resources/{acid['id']}$")
    place = f"resources/{acid['id']}/events?limit=1"

    def first_page(route: Route) -> None:
        answer = route.fetch()
        told, page = answer.json(), client.get(place)
        changed = {**told, "events": page["events"], "events_next": page["next"]}
        route.fulfill(response=answer, json=changed)

    observer.page.route(whole, first_page)
    short_pages(observer)
    observer.open(f"lab?sel={acid['id']}")
    expect(observer.at("event-row")).to_have_count(1)
    observer.press("show-more")
    expect(observer.at("event-row")).to_have_count(FEW)
    shoot(observer, "list-events-more")
    observer.press("show-more")
    expect(observer.at("event-row")).to_have_count(2 * FEW)


def test_a_place_without_room_is_shown_with_the_reason(visit: Visit, stack: Stack) -> None:
    client = stack.client()
    rows = client.get("resources")["resources"]
    bench = next(row for row in rows if row["key"] == "bench_1")
    vial = "0198a000-0000-7000-8000-00000000c0de"
    create = {"op": "create", "resource_id": vial, "parent_id": bench["id"], "key": "vial_c"}
    operation = {**create, "name": "Vial C", "kind": "vial"}
    client.call("POST", "operations", {"operation": operation, "note": "for the test"})
    chemist = visit("chemist")
    chemist.open(f"lab?sel={vial}")
    chemist.press("carry")
    chemist.at("carry-place").click()
    balance = chemist.page.get_by_role("option", name=re.compile("Balance 1"))
    expect(balance).to_contain_text("Flask 1 stands there")
    shoot(chemist, "list-carry", is_whole=False)
    archive_id = next(row["id"] for row in rows if row["kind"] == "archive")
    archive = {"op": "delete", "resource_id": vial, "archive_id": archive_id}
    client.call("POST", "operations", {"operation": archive, "note": "the test is over"})
