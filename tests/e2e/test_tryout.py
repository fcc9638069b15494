"""An author brings a driver, drives it on a simulated instrument, and the approver reads of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Locator, expect

from tests.e2e.conftest import Visit
from tests.e2e.visitor import Visitor
from tests.system.stack import Stack
from workers.sandbox.confinement import is_possible

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
    pytest.mark.skipif(not is_possible(), reason="this kernel cannot confine: nothing is tried"),
]

SOURCE = Path("drivers/processing/lauda_loop.py")
SOON_MS = 60_000


def action(visitor: Visitor, name: str) -> Locator:
    return visitor.page.locator(f"[data-testid=try-action][data-action={name}]")


def fault(visitor: Visitor, name: str) -> Locator:
    return visitor.page.locator(f"[data-testid=try-fault][data-fault={name}]")


def status(visitor: Visitor, name: str) -> Locator:
    return visitor.page.locator(f"[data-testid=try-status][data-status={name}]")


def brought(stack: Stack) -> str:
    """Have the admin propose another version of the thermostat's driver; return its id."""
    body = {
        "module": "drivers.processing.lauda_loop",
        "source": f"{SOURCE.read_text()}\n# to be tried\n",
        "note": "to be tried",
    }
    return str(stack.client("admin").call("POST", "drivers", body)["id"])


def test_a_driver_is_tried_before_anybody_approves_it(visit: Visit, stack: Stack) -> None:
    version = brought(stack)
    admin, approver = visit("admin"), visit("approver")
    admin.open(f"drivers/{version}")
    expect(admin.at("driver-tried")).to_contain_text("Nobody has tried it")
    admin.press("try-open")
    expect(admin.at("try-begin")).to_be_disabled()
    admin.at("try-model").select_option("lauda_loop")
    admin.at("try-speed").select_option("100")
    admin.at("try-config").locator("summary").click()
    admin.at("try-config").get_by_label("Settle").fill("0")
    admin.press("try-begin")
    expect(admin.at("try")).to_have_attribute("data-state", "running", timeout=SOON_MS)

    admin.press("try-read")
    expect(status(admin, "temperature_c")).to_contain_text(re.compile(r"2[12]\.\d"))
    expect(admin.at("try-line")).to_contain_text("IN_PV_00")
    deed = action(admin, "reach_temperature")
    deed.locator("summary").click()
    deed.get_by_label("Temperature").first.fill("30 °C")
    deed.get_by_label("Tolerance").first.fill("0.5")
    admin.press(deed.get_by_test_id("try-do"))
    done = admin.page.locator("[data-testid=try-act][data-sort=act]").first
    expect(done).to_have_attribute("data-answered", "true", timeout=SOON_MS)
    expect(done).to_have_attribute("data-code", "")

    admin.press(fault(admin, "no_answer").get_by_test_id("try-fault-open"))
    admin.press(fault(admin, "no_answer").get_by_test_id("try-fault-on"))
    expect(fault(admin, "no_answer")).to_have_attribute("data-on", "true", timeout=SOON_MS)
    admin.press("try-read")
    silent = admin.page.locator("[data-testid=try-act][data-sort=read]").first
    expect(silent).to_contain_text("no whole answer in time", timeout=SOON_MS)
    admin.press("try-cure")
    expect(fault(admin, "no_answer")).to_have_attribute("data-on", "false", timeout=SOON_MS)

    admin.press("try-end")
    expect(admin.at("try")).to_have_attribute("data-state", "ended", timeout=SOON_MS)
    expect(admin.at("try-note")).to_contain_text("its author ended it")
    approver.open(f"drivers/{version}")
    tried = approver.at("driver-tried")
    expect(tried).to_contain_text("1 of 3 actions, statuses read, 1 fault")
    expect(tried).to_contain_text("Never ended well:")


def test_who_may_not_bring_drivers_reads_why(visit: Visit, stack: Stack) -> None:
    rows = stack.client("admin").get("drivers")["drivers"]
    loop = next(row["id"] for row in rows if row["module"].endswith("lauda_loop"))
    chemist = visit("chemist")
    chemist.open(f"drivers/{loop}/try?on=new")
    chemist.at("try-model").select_option("lauda_loop")
    expect(chemist.at("try-begin")).to_be_disabled()
    expect(chemist.at("try-form")).to_contain_text("Needs the role admin")
