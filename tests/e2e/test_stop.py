"""Stop lab is one press on every page, and only a person with the right and a reason ends it."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Visit
from tests.e2e.visitor import Visitor
from tests.system.stack import Stack

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]


def stop(visitor: Visitor) -> None:
    """Press once, and see that every host has heard it."""
    visitor.presses = 0
    visitor.press("stop-lab")
    assert visitor.presses == 1
    visitor.at("stop-banner").wait_for()
    expect(visitor.page.locator("[data-testid=stop-host][data-state=waiting]")).to_have_count(0)
    expect(visitor.page.locator("[data-testid=stop-host][data-state=acknowledged]")).to_have_count(
        1
    )


def reset(admin: Visitor) -> None:
    """Say why it is safe to go on."""
    admin.press("reset-lab")
    expect(admin.at("reset-confirm")).to_be_disabled()
    admin.at("reset-reason").fill("looked at the bench")
    admin.press("reset-confirm")
    expect(admin.at("stop-banner")).to_have_count(0)


def end(stack: Stack, run_id: str) -> None:
    """Abort what the stop has left paused."""
    if stack.client().run(run_id)["state"] != "aborted":
        stack.client().call("POST", f"runs/{run_id}/abort", {"reason": "end of the test"})


@pytest.fixture
def _reset_after(stack: Stack) -> Iterator[None]:
    """Leave no stopped lab to the tests that follow."""
    yield
    if stack.client().get("lab")["stop"]["is_stopped"]:
        stack.client("admin").call("POST", "lab/reset", {"reason": "end of the test"})


@pytest.mark.usefixtures("_reset_after")
def test_stop_is_one_press_on_three_pages_and_holds_until_an_admin_resets(
    visit: Visit, stack: Stack
) -> None:
    workflows = {w["name"]: w["id"] for w in stack.client().get("workflows")["workflows"]}
    chemist, observer, admin = visit("chemist"), visit("observer"), visit("admin")
    admin.open("devices")

    run = stack.client().start_step("wait", {"duration": "20 min"})
    chemist.open(f"runs/{run['id']}")
    chemist.wait_for_state("running")
    stop(chemist)
    expect(chemist.at("run")).to_have_attribute("data-state", re.compile("^(paused|aborted)$"))
    expect(chemist.at("reset-lab")).to_be_disabled()
    reset(admin)
    expect(chemist.at("stop-banner")).to_have_count(0)
    end(stack, run["id"])

    observer.open("")
    observer.at("home").wait_for()
    stop(observer)
    reset(admin)

    chemist.open(f"workflows/{workflows['Move 5 mL of water']}/edit")
    chemist.at("editor").wait_for()
    stop(chemist)
    chemist.press("run")
    expect(chemist.at("start-run")).to_be_disabled()
    strokes = len(stack.actuations("pump_1"))
    version = next(
        row
        for row in stack.client().get("workflows")["workflows"]
        if row["name"].startswith("Move")
    )["latest_version"]
    refused = stack.client().raw("POST", "runs", {"version_id": version["id"]})
    assert not refused.is_success
    assert len(stack.actuations("pump_1")) == strokes
    reset(admin)
    chemist.key("Escape")
    expect(chemist.at("stop-banner")).to_have_count(0)
