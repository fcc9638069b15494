"""A way is never missing: a step that goes keeps the order, a page that fails leads on."""

from __future__ import annotations

import json
from typing import Any
from uuid import uuid4

import pytest
from playwright.sync_api import Route, expect

from tests.e2e.conftest import Visit
from tests.e2e.drawing import draft, new_workflow, wait_until_saved
from tests.e2e.pictures import shoot
from tests.e2e.visitor import Visitor
from tests.system.stack import Stack

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

KINDS = {
    "workflows/{}/edit": "Show all workflows",
    "runs/{}": "Show all runs",
    "devices/{}": "Show all devices",
    "hosts/{}": "Show all devices and hosts",
    "drivers/{}": "Show all drivers",
    "files/{}": "Show all files",
    "approvals/{}": "Show all requests",
    "lineage/{}": "Show the lab",
}
CHAIN = [("wait_1", "wait_2"), ("wait_2", "wait_3")]


def three_waits(visitor: Visitor, name: str) -> str:
    """Draw three steps one after another, and return the id of the workflow."""
    workflow = new_workflow(visitor, name)
    for _ in range(3):
        visitor.press("add-wait")
    wait_until_saved(visitor)
    return workflow


def edges(stack: Stack, workflow: str) -> list[tuple[str, str]]:
    return [(edge["source"], edge["target"]) for edge in draft(stack, workflow)["edges"]]


@pytest.mark.parametrize("way", ["Delete", "Backspace", "Control+x", "menu", "box"])
def test_a_middle_step_that_is_deleted_keeps_the_order_however_it_is_deleted(
    visit: Visit, stack: Stack, way: str
) -> None:
    chemist = visit("chemist")
    workflow = three_waits(chemist, f"Deleted by {way}")
    assert edges(stack, workflow) == CHAIN
    middle = chemist.at("step-wait_2")
    if way == "box":
        chemist.page.get_by_role("button", name="Fit").click()
        chemist.page.wait_for_timeout(600)
        box = middle.bounding_box()
        assert box is not None
        mouse = chemist.page.mouse
        mouse.move(box["x"] - 14, box["y"] - 30)
        mouse.down()
        mouse.move(box["x"] + box["width"] + 14, box["y"] + box["height"] + 30, steps=8)
        mouse.up()
        chemist.key("Delete")
    else:
        middle.click()
        if way == "menu":
            chemist.press("step-menu")
            chemist.press(chemist.page.get_by_role("menuitem", name="Delete"))
        else:
            chemist.key(way)
    expect(chemist.at("edit-notice")).to_contain_text("step 1 now leads to the former step 3.")
    wait_until_saved(chemist)
    assert edges(stack, workflow) == [("wait_1", "wait_3")]
    if way == "menu":
        shoot(chemist, "editor-step-deleted", is_whole=False)
    chemist.press("notice-undo")
    wait_until_saved(chemist)
    assert edges(stack, workflow) == CHAIN


def test_what_does_not_exist_leads_to_all_of_its_kind(visit: Visit) -> None:
    chemist = visit("chemist")
    for path, all_of_it in KINDS.items():
        chemist.open(path.format(uuid4()))
        told = chemist.at("missing").first
        expect(told).to_contain_text("does not exist, or you may not see it.")
        expect(told.get_by_role("link", name=all_of_it)).to_be_visible()
        if path.startswith("workflows"):
            shoot(chemist, "missing-workflow")


def test_a_page_whose_server_fails_offers_to_try_again(visit: Visit, stack: Stack) -> None:
    chemist = visit("chemist")
    workflow = three_waits(chemist, "Behind a failure")

    def fail(route: Route) -> None:
        route.fulfill(status=500, body="{}", content_type="application/json")

    pattern = f"**/api/v1/workflows/{workflow}"
    chemist.page.route(pattern, fail)
    chemist.open(f"workflows/{workflow}/edit")
    told = chemist.at("failed")
    expect(told.get_by_role("link", name="Show all workflows")).to_be_visible()
    shoot(chemist, "failed-workflow")
    chemist.page.unroute(pattern)
    # Only the failure that was made here is forgiven.
    assert {status for status in chemist.refusals if status >= 500} == {500}
    chemist.refusals.clear()
    chemist.press(told.get_by_role("button", name="Try again"))
    expect(chemist.at("editor")).to_be_visible()


def test_a_page_that_meets_what_it_cannot_show_leads_on(visit: Visit, stack: Stack) -> None:
    chemist = visit("chemist")
    workflow = three_waits(chemist, "Broken")

    def bend(route: Route) -> None:
        answer: dict[str, Any] = route.fetch().json()
        route.fulfill(body=json.dumps(answer | {"versions": None}), content_type="application/json")

    pattern = f"**/api/v1/workflows/{workflow}"
    chemist.page.route(pattern, bend)
    chemist.open(f"workflows/{workflow}/edit")
    told = chemist.at("broken")
    expect(told).to_contain_text("This page failed")
    shoot(chemist, "broken-page")
    chemist.page.unroute(pattern)
    chemist.press(told.get_by_role("button", name="Try again"))
    expect(chemist.at("editor")).to_be_visible()
    chemist.complaints.clear()
