"""From the page of a pump to a calibration that a second person has accepted."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Visit
from tests.e2e.visitor import Visitor
from tests.system.stack import Stack, is_over

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

FIELDS = {
    "certificate": "D-K-15192-2026-11",
    "expanded": "0.4",
    "due_on": "2099-01-01",
    "water_c": "22",
    "pressure_kpa": "101.3",
}


def choose(visitor: Visitor, name: str, label: str) -> None:
    """Pick one of a list by its name."""
    field = visitor.at(f"calibrate-{name}")
    field.click()
    field.fill(label)
    visitor.page.get_by_role("option", name=label).first.click()


def order(chemist: Visitor, pump_id: str) -> None:
    """Fill in the form of a pump and start its run."""
    chemist.open(f"devices/{pump_id}")
    card = chemist.at("calibration-volume")
    expect(card).to_contain_text("It was never calibrated")
    expect(card).to_contain_text("Its maker states 1.00\u202f%")
    chemist.press("calibrate")
    expect(chemist.at("calibrate-send")).to_be_disabled()
    choose(chemist, "source_id", "Water bottle")
    choose(chemist, "balance_id", "Balance 1")
    choose(chemist, "target_id", "Flask 1")
    for name, text in FIELDS.items():
        chemist.at(f"calibrate-{name}").fill(text)
    chemist.press("calibrate-send")


def test_a_pump_is_calibrated_on_its_page_and_a_second_person_accepts_it(
    stack: Stack, visit: Visit
) -> None:
    rows = stack.client().get("devices")["devices"]
    pump = next(row for row in rows if row["key"] == "pump_1")
    chemist = visit("chemist")
    order(chemist, pump["id"])
    result = chemist.at("calibration-result")
    expect(result).to_have_attribute("data-state", "measuring")
    (row,) = stack.client().get(f"devices/{pump['id']}/calibrations")["quantities"][0]["history"]
    run = stack.client().wait_for_run(row["run"]["id"], is_over, 240)
    assert run["state"] == "complete"
    expect(result).to_have_attribute("data-state", "awaiting")
    expect(chemist.at("residuals").locator(".dot")).to_have_count(9)
    chemist.press("calibration-review")
    expect(chemist.at("why-not")).to_contain_text("A second person has to answer")
    expect(chemist.at("approve")).to_be_disabled()

    approver = visit("approver")
    approver.open("approvals")
    approver.press(approver.at("approval-row").filter(has_text="Calibration 1 of volume of Pump 1"))
    change = approver.at("calibration-change")
    expect(change).to_contain_text("never calibrated")
    expect(change).to_contain_text("Balance 1, D-K-15192-2026-11")
    expect(approver.at("residuals").locator(".dot")).to_have_count(9)
    approver.at("decision-comment").fill("residuals look at random")
    approver.press_signed("approve", "decided")
    expect(approver.at("decided")).to_contain_text("approves the calibration")
    approver.open(f"devices/{pump['id']}")
    newest = approver.at("calibration-newest")
    expect(newest).to_have_attribute("data-standing", "in_force")
    expect(newest).to_contain_text("in 364 days")
    expect(newest).to_contain_text("Balance 1, D-K-15192-2026-11")

    approver.press("calibration-withdraw")
    approver.at("withdraw-reason").fill("the test is over")
    approver.press("withdraw-send")
    expect(newest).to_have_attribute("data-standing", "withdrawn")
    expect(newest).to_contain_text("the test is over")
    assert not chemist.complaints
    assert not approver.complaints
