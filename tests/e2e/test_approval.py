"""Heating waits for a second person, who sees all of it before saying yes."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Visit
from tests.system.stack import Stack

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]


def test_heating_waits_for_a_second_person_and_then_heats(visit: Visit, stack: Stack) -> None:
    chemist, approver = visit("chemist"), visit("approver")
    chemist.open("workflows")
    chemist.press(chemist.page.get_by_role("link", name="Heat and stir", exact=True))
    chemist.press("run")
    expect(chemist.at("policies")).to_contain_text("needs a second person")
    expect(chemist.at("start-run")).to_have_text("Request approval")
    chemist.press("start-run")
    chemist.wait_for_state("awaiting_approval")
    expect(chemist.at("run-state")).to_have_text("Awaits approval")
    run_url = chemist.page.url

    chemist.press(chemist.at("approval-card").get_by_role("link", name="Open the request"))
    expect(chemist.at("approve")).to_be_disabled()
    expect(chemist.at("why-not")).to_contain_text("second person")

    approver.open(chemist.page.url.removeprefix(stack.url))
    expect(approver.at("review")).to_contain_text("60 °C")
    expect(approver.page.locator("#review-actions tbody tr")).not_to_have_count(0)
    for opened in approver.at("decision").get_by_role("button", name="Open").all():
        approver.press(opened)
    approver.at("decision-comment").fill("the hood is on")
    approver.press_signed("approve", "decided")
    expect(approver.at("decided")).to_contain_text("Li Na")
    expect(approver.at("decided")).to_contain_text("the hood is on")

    chemist.page.goto(run_url)
    chemist.wait_for_state("complete", 120)
    sent = b"".join(data for direction, data in stack.tap("line2.tty") if direction == "in")
    assert b"OUT_SP_1 60" in sent
    assert b"STOP_1" in sent
