"""A connection is taken off at Lab by an admin at the keyboard, and not while a run uses it."""

from __future__ import annotations

import json

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Visit
from tests.e2e.test_doubt import is_drawing
from tests.e2e.visitor import Visitor
from tests.system.stack import Stack, is_over

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]


def ask(admin: Visitor, resource_id: str, why: str) -> None:
    """Open what is asked of the first port, and answer it, all by keyboard."""
    admin.open(f"lab?sel={resource_id}")
    admin.at("take-off").first.focus()
    admin.key("Enter")
    expect(admin.at("take-off-empty")).to_be_focused()
    admin.key("Space")
    admin.key("Tab")
    admin.page.keyboard.type(why)
    for _ in range(2):
        admin.key("Tab")
    expect(admin.at("take-off-send")).to_be_focused()
    admin.key("Enter")


def focused(visitor: Visitor) -> str:
    """Return the text of what has the focus."""
    return str(visitor.page.evaluate("document.activeElement.innerText"))


def test_a_connection_is_taken_off_by_keyboard_and_not_while_a_run_goes_through(
    visit: Visit, stack: Stack
) -> None:
    keys = stack.keys()
    ends = {"source": keys["acid"], "target": keys["waste"]}
    admin, client = visit("admin"), stack.client()
    run = client.start_step("transfer", {**ends, "volume": "2 mL", "flow_rate": "0.5 mL/min"})
    client.wait_for_run(run["id"], is_drawing)
    ask(admin, keys["waste"], "the waste is to go")
    refused = admin.at("refused")
    expect(refused).to_contain_text(f"run #{run['number']}", ignore_case=True)
    expect(refused).to_contain_text("Valve 1 to Waste")
    assert "let the run end, or stop it" in focused(admin), "the focus was lost"
    admin.key("Escape")
    expect(admin.at("take-off-form")).to_have_count(0)
    assert client.wait_for_run(run["id"], is_over, 90)["state"] == "complete"

    ask(admin, keys["acid"], "the acid has gone")
    expect(admin.at("take-off")).to_have_count(0)
    expect(admin.page.get_by_text("Valve 1 and Acid taken apart")).to_be_visible()
    expect(admin.page.get_by_role("heading", name="Acid")).to_be_focused()
    ways = json.dumps(client.get(f"resources/{keys['acid']}")["ports"])
    assert ways == "[]"


def test_who_may_not_admit_devices_takes_nothing_off(visit: Visit, stack: Stack) -> None:
    chemist = visit("chemist")
    chemist.open(f"lab?sel={stack.keys()['dye']}")
    expect(chemist.at("take-off").first).to_be_disabled()
