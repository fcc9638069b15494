"""A double click is one wish, and a second run is asked about."""

from __future__ import annotations

import pytest
from playwright.sync_api import Route, expect

from tests.e2e.conftest import Visit
from tests.e2e.visitor import Visitor
from tests.system.stack import Stack

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

HEAT = "Heat and stir"


def runs_of(stack: Stack) -> list[int]:
    """Return the numbers of all runs."""
    return [row["number"] for row in stack.client().get("runs?limit=500")["runs"]]


def ready_to_start(visitor: Visitor, name: str) -> None:
    """Open a workflow and the sheet with its plan."""
    visitor.open("workflows")
    visitor.press(visitor.page.get_by_role("link", name=name, exact=True).last)
    visitor.press("run")
    expect(visitor.at("start-run")).to_be_enabled()


def give_up(stack: Stack) -> None:
    """End every run that waits."""
    client = stack.client()
    for row in client.get("runs?limit=500")["runs"]:
        if row["state"] not in {"complete", "aborted"}:
            client.call("POST", f"runs/{row['id']}/abort", {"reason": "tried"})


def test_a_double_click_on_start_makes_one_run(visit: Visit, stack: Stack) -> None:
    before, chemist = runs_of(stack), visit("chemist")
    ready_to_start(chemist, HEAT)
    chemist.at("start-run").evaluate("button => { button.click(); button.click() }")
    chemist.page.wait_for_url("**/runs/*")
    chemist.wait_for_state("awaiting_approval")
    assert len(runs_of(stack)) == len(before) + 1
    give_up(stack)


def test_a_start_whose_answer_was_lost_is_tried_again_and_makes_one_run(
    visit: Visit, stack: Stack
) -> None:
    before, chemist = runs_of(stack), visit("chemist")
    ready_to_start(chemist, HEAT)
    lost: list[str] = []

    def lose(route: Route) -> None:
        if route.request.method != "POST" or lost:
            route.continue_()
            return
        lost.append(route.fetch().text())
        route.abort()

    chemist.page.route("**/api/v1/runs", lose)
    chemist.press("start-run")
    chemist.at("try-again").click()
    chemist.page.wait_for_url("**/runs/*")
    assert lost
    assert len(runs_of(stack)) == len(before) + 1
    give_up(stack)


def test_a_second_run_is_asked_about_and_the_first_is_shown(visit: Visit, stack: Stack) -> None:
    first = stack.client().start(HEAT)
    before, chemist = runs_of(stack), visit("chemist")
    ready_to_start(chemist, HEAT)
    chemist.press("start-run")
    expect(chemist.at("second-run")).to_contain_text(f"Run #{first['number']}")
    chemist.press("show-first")
    chemist.page.wait_for_url(f"**/runs/{first['id']}")
    assert runs_of(stack) == before
    ready_to_start(chemist, HEAT)
    chemist.press("start-run")
    chemist.press("start-second")
    chemist.page.wait_for_url("**/runs/*")
    chemist.wait_for_state("awaiting_approval")
    assert len(runs_of(stack)) == len(before) + 1
    give_up(stack)
