"""Drawing a transfer with keyboard and clicks: what does not fit is said, nothing is lost."""

from __future__ import annotations

import json
import time
from typing import Any

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Visit
from tests.e2e.drawing import (
    add,
    draft,
    field,
    new_workflow,
    pick,
    wait_until_checked,
    wait_until_saved,
    write,
)
from tests.e2e.visitor import Visitor, plain
from tests.system.stack import Stack

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

SAYS_WITHIN_S = 2.5
"""A second on an idle machine; tests may share theirs."""


def draw_transfer(visitor: Visitor, name: str, volume: str = "8 mL") -> str:
    """Draw water into the reactor, and return the id of the workflow."""
    workflow = new_workflow(visitor, name)
    add(visitor, "Transfer")
    pick(visitor, "source", "Water")
    pick(visitor, "target", "Reactor 1")
    write(visitor, "volume", volume)
    wait_until_checked(visitor)
    return workflow


def written(stack: Stack, workflow: str) -> str:
    """Return the draft on the server, to the byte."""
    return json.dumps(draft(stack, workflow), ensure_ascii=False)


def planned(visitor: Visitor, stack: Stack, workflow: str, volume: str) -> tuple[str, list[Any]]:
    """Type a volume; return the actions that the page shows and the amounts of their plan."""
    write(visitor, "volume", volume)
    wait_until_checked(visitor)
    wait_until_saved(visitor)
    document = draft(stack, workflow)
    plan = stack.client().call("POST", "workflows/check", {"document": document})["plan"]
    return plain(visitor.at("compiled").inner_text()), [job["args"] for job in plan["jobs"]]


def test_a_transfer_is_drawn_saved_and_still_there_after_a_reload(
    visit: Visit, stack: Stack
) -> None:
    chemist = visit("chemist")
    workflow = draw_transfer(chemist, "Draw water")
    expect(chemist.at("no-findings")).to_be_visible()
    expect(chemist.at("compiled")).to_contain_text("Pump 1")
    chemist.press("save-version")
    chemist.at("version-note").fill("first")
    chemist.key("Enter")
    expect(chemist.at("versions")).to_contain_text("v1")
    write(chemist, "volume", "7 mL")
    wait_until_saved(chemist)
    before = written(stack, workflow)
    chemist.page.reload()
    expect(chemist.at("versions")).to_contain_text("v1")
    chemist.press(chemist.page.locator("article[data-step]"))
    expect(field(chemist, "volume")).to_have_value("7")
    expect(field(chemist, "source")).to_have_value("Water")
    expect(field(chemist, "target")).to_have_value("Reactor 1")
    assert written(stack, workflow) == before
    assert draft(stack, workflow)["steps"][0]["params"]["volume"] == "7 mL"


def test_a_volume_that_does_not_fit_is_said_at_once_at_its_field(
    visit: Visit, stack: Stack
) -> None:
    chemist = visit("chemist")
    draw_transfer(chemist, "Too much")
    box = field(chemist, "volume")
    expect(box).not_to_have_attribute("aria-invalid", "true")
    write(chemist, "volume", "180 mL")
    asked = time.monotonic()
    expect(box).to_have_attribute("aria-invalid", "true")
    assert time.monotonic() - asked < SAYS_WITHIN_S
    expect(chemist.at("findings-bar")).to_contain_text("Reactor 1")
    expect(chemist.page.locator("[data-field=volume] [role=alert]")).to_contain_text("mL")
    chemist.press("run")
    expect(chemist.at("start-run")).to_be_disabled()


def test_a_mass_is_no_volume(visit: Visit, stack: Stack) -> None:
    chemist = visit("chemist")
    workflow = draw_transfer(chemist, "Five grams", "5 g")
    expect(field(chemist, "volume")).to_have_attribute("aria-invalid", "true")
    expect(chemist.page.locator("[data-field=volume] [role=alert]")).to_be_visible()
    wait_until_saved(chemist)
    answer = stack.client().call("POST", "workflows/check", {"document": draft(stack, workflow)})
    assert answer["plan"] is None
    chemist.press("run")
    expect(chemist.at("start-run")).to_be_disabled()


def test_three_ways_to_write_a_volume_make_one_plan(visit: Visit, stack: Stack) -> None:
    chemist = visit("chemist")
    workflow = draw_transfer(chemist, "Units")
    small = [planned(chemist, stack, workflow, text) for text in ("250 uL", "250 µL", "0.25 mL")]
    amounts = [args["volume_ul"] for args in small[0][1] if "volume_ul" in args]
    assert amounts == [250.0, 250.0]
    assert small[1] == small[0]
    assert small[2] == small[0]
    assert planned(chemist, stack, workflow, "8 mL") != small[0]


def test_more_than_ten_edits_are_undone_and_done_again_to_the_byte(
    visit: Visit, stack: Stack
) -> None:
    chemist = visit("chemist")
    workflow = new_workflow(chemist, "Undo")
    first = written(stack, workflow)
    for kind in ("transfer", "wait", "stir", "weigh", "transfer", "measure_ph", "wait"):
        chemist.press(f"add-{kind}")
    chemist.page.locator("article[data-step]").first.click()
    pick(chemist, "source", "Water")
    pick(chemist, "target", "Flask 1")
    write(chemist, "volume", "3 mL")
    chemist.press("step-menu")
    chemist.press(chemist.page.get_by_role("menuitem", name="Duplicate"))
    chemist.press(chemist.page.get_by_role("button", name="Tidy"))
    wait_until_saved(chemist)
    last = written(stack, workflow)
    assert last != first
    assert press_to_the_end(chemist, "undo") >= 10
    wait_until_saved(chemist)
    assert written(stack, workflow) == first
    assert press_to_the_end(chemist, "redo") >= 10
    wait_until_saved(chemist)
    assert written(stack, workflow) == last


def press_to_the_end(chemist: Visitor, button: str) -> int:
    """Undo or redo until nothing is left, and return how many edits that were."""
    count = 0
    while chemist.at(button).is_enabled():
        chemist.press(button)
        count += 1
    return count


def step(kind: str, **params: str) -> dict[str, Any]:
    """Return the one step of a workflow."""
    return {"id": "s1", "kind": kind, "params": params, "position": {"x": 0, "y": 0}}


def test_the_draft_of_somebody_else_is_asked_about_and_neither_saved_nor_started(
    visit: Visit, stack: Stack
) -> None:
    chemist, other = visit("chemist"), visit("approver")
    document = {"schema": "labweb.workflow/1", "name": "Two tabs", "edges": []}
    mine = {**document, "steps": [step("wait", duration="1 s")]}
    made = stack.client().call("POST", "workflows", {"name": "Two tabs", "document": mine})
    address = f"workflows/{made['id']}/edit"
    for tab in (chemist, other):
        tab.open(address)
        wait_until_checked(tab)
    runs = len(stack.client().get("runs?limit=500")["runs"])
    other.press(other.page.locator("article[data-step]"))
    write(other, "duration", "7 s")
    wait_until_saved(other)
    expect(chemist.at("draft-conflict")).to_be_visible()
    chemist.press("run")
    expect(chemist.at("start-run")).to_be_disabled()
    chemist.key("Escape")
    chemist.press("save-version")
    chemist.press("save-version-confirm")
    expect(chemist.page.get_by_role("dialog")).to_contain_text("Somebody else saved")
    chemist.key("Escape")
    found = stack.client().get(f"workflows/{made['id']}")
    assert found["versions"] == []
    assert len(stack.client().get("runs?limit=500")["runs"]) == runs
    chemist.press("load-theirs")
    expect(chemist.at("draft-conflict")).to_have_count(0)
    wait_until_checked(chemist)
    chemist.press("run")
    chemist.press("start-run")
    chemist.page.wait_for_url("**/runs/*")
    run = stack.client().run(chemist.page.url.rstrip("/").split("/")[-1])
    assert run["document"]["steps"][0]["params"]["duration"] == "7 s"


def test_what_was_drawn_as_the_session_ended_is_offered_after_signing_in(
    visit: Visit, stack: Stack
) -> None:
    chemist = visit("chemist")
    workflow = new_workflow(chemist, "Signed out")
    chemist.context.clear_cookies(name="sessionid")
    chemist.press("add-wait")
    chemist.page.wait_for_url("**/login?next=*")
    assert draft(stack, workflow)["steps"] == []
    chemist.sign_in(stack, "chemist")
    chemist.press("offer-restore")
    expect(chemist.page.locator("article[data-step]")).to_have_count(1)
    wait_until_saved(chemist)
    assert [found["kind"] for found in draft(stack, workflow)["steps"]] == ["wait"]
    chemist.page.reload()
    expect(chemist.page.locator("article[data-step]")).to_have_count(1)
    expect(chemist.at("draft-offer")).to_have_count(0)
