"""States that a page seldom has, each brought about as a lab would, and looked at."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.drawing import wait_until_checked
from tests.e2e.pictures import shoot
from tests.e2e.test_recipe import WARM, wait_for_plan
from tests.e2e.visitor import Visitor, visiting
from tests.labweb.photos import a_photo
from tests.system.stack import Stack, is_over, running

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

PUMP = Path("drivers/connectors/tricontinent_c3000.py")


@pytest.fixture(scope="module")
def stack() -> Iterator[Stack]:
    """Start a lab of its own: what is given up half-way leaves a syringe full."""
    folder = Path(tempfile.mkdtemp(prefix="ls-", dir="/tmp"))
    try:
        with running(folder / "lab", speed=20.0, with_twin=True) as lab:
            yield lab
    finally:
        shutil.rmtree(folder, ignore_errors=True)


MORE = WARM.replace("2 mL", "8 mL")


def saved_recipe(
    chemist: Visitor, folder: Path, text: str = WARM, name: str = "warm water"
) -> None:
    """Open the recipe that warms water, bind it, and save it as a workflow."""
    file = folder / f"{name}.xdl"
    file.write_text(text, "utf-8")
    chemist.open("workflows")
    chemist.at("open-xdl-input").set_input_files(file)
    wait_for_plan(chemist)
    chemist.page.get_by_label("Water is").select_option("water")
    chemist.at("planned-step").filter(has_text="from water to reactor_1").first.wait_for()
    chemist.press("save-recipe")
    chemist.press("save-confirm")
    expect(chemist.at("findings-bar")).to_have_attribute("data-state", "checked")


def test_a_proof_that_is_lost_is_told_in_the_editor_and_where_it_starts(
    chromium: Browser, stack: Stack, tmp_path: Path
) -> None:
    with visiting(chromium, stack, "chemist") as chemist:
        saved_recipe(chemist, tmp_path)
        chemist.press("run")
        chemist.at("proof-kept").wait_for()
        shoot(chemist, "proof-kept", is_whole=False)
        chemist.press(chemist.at("run-sheet").get_by_role("button", name="Cancel"))
        expect(chemist.at("proof-kept")).to_have_count(0)
        node = chemist.page.locator(".react-flow__node").filter(has_text="40").first
        chemist.press(node)
        chemist.at("inspector").wait_for()
        box = chemist.at("field-temperature")
        box.fill("55 °C")
        box.press("Tab")
        wait_until_checked(chemist)
        chemist.at("proof-lost").wait_for()
        shoot(chemist, "proof-lost", is_whole=False)
        chemist.press("run")
        chemist.at("proof-lost-sheet").wait_for()
        shoot(chemist, "proof-lost-sheet", is_whole=False)


def is_moving(run: dict[str, Any]) -> bool:
    """Tell whether liquid moves, or is about to."""
    strokes = [job for job in run["jobs"] if job["action"] in {"aspirate", "dispense"}]
    return any(job["state"] in {"accepted", "running"} for job in strokes)


def test_a_run_that_left_its_proof_says_so_and_waits(
    chromium: Browser, stack: Stack, tmp_path: Path
) -> None:
    with visiting(chromium, stack, "chemist") as chemist:
        saved_recipe(chemist, tmp_path, MORE, "more water")
        chemist.press("run")
        chemist.press("start-run")
        chemist.page.wait_for_url("**/runs/*")
        run_id = chemist.page.url.rstrip("/").split("/")[-1]
        stack.client().wait_for_run(run_id, is_moving)
        with stack.silent("pump_1"):
            stack.client().wait_for_run(run_id, is_over)
            chemist.at("resolve-card").or_(chemist.at("recovery-card")).first.wait_for()
            shoot(chemist, "run-problem")
        stack.wait_until_online()
        give_up(stack, run_id)
        chemist.at("departed-card").wait_for()
        shoot(chemist, "run-departed")
        stack.client().call("POST", f"runs/{run_id}/abort", {"reason": "only looked at"})


def is_answered(run: dict[str, Any]) -> bool:
    """Tell whether no answer is on its way to a host."""
    return is_over(run) and all(job["state"] != "in_doubt" for job in run["jobs"])


DID_NOT = {"answer": "did_not", "despite_reading": True, "note": "the plunger stands still"}
"""How far it had come when its instrument fell silent differs from time to time."""


def give_up(stack: Stack, run_id: str) -> None:
    """Say of what went wrong that it did not happen, and leave it out."""
    client = stack.client()
    for state, act, body in (
        ("in_doubt", "resolve", DID_NOT),
        ("", "recover", {"choice": "skip", "note": "left out"}),
    ):
        rows = client.wait_for_run(run_id, is_over if state else is_answered)["jobs"]
        wrong = [job for job in rows if job["state"] in {"in_doubt", "rejected", "aborted"}]
        for job in wrong:
            if state in {"", job["state"]}:
                client.call("POST", f"jobs/{job['id']}/{act}", body)


def test_the_parts_that_a_version_changes_are_shown_before_they_are_decided(
    chromium: Browser, stack: Stack
) -> None:
    text = PUMP.read_text().replace("Config], Pump, Valve)", "Config], Pump)")
    body = {"module": "drivers.connectors.tricontinent_c3000", "source": text, "note": "no valve"}
    version = stack.client("admin").call("POST", "drivers", body)["id"]
    stack.client("approver").call("POST", f"drivers/{version}/decision", {"is_approved": True})
    with visiting(chromium, stack, "admin") as admin:
        admin.open(f"drivers/{version}")
        place = admin.page.locator("[data-testid=driver-place][data-device=pump_1]")
        admin.press(place.get_by_test_id("driver-change"))
        admin.at("part-changes").wait_for()
        shoot(admin, "parts-dialog", is_whole=False)
        expect(admin.at("change-send")).to_be_disabled()


def test_a_device_shows_its_photo_and_which_one_it_is(chromium: Browser, stack: Stack) -> None:
    rows = stack.client().get("devices")["devices"]
    device = next(row for row in rows if row["key"] == "balance_1")
    with visiting(chromium, stack, "admin") as admin:
        admin.open(f"devices/{device['id']}")
        admin.at("bring-photo").wait_for()
        shoot(admin, "device-no-photo")
        picture = {"name": "b.png", "mimeType": "image/png", "buffer": a_photo(form="PNG")}
        admin.at("bring-photo-input").set_input_files(picture)  # type: ignore[arg-type]
        shown = admin.at("device-photo").get_by_role("img")
        shown.wait_for()
        admin.page.wait_for_function("document.querySelector('.photo img').naturalWidth === 640")
        admin.press("show-name")
        admin.at("show-itself").get_by_role("link").wait_for()
        shoot(admin, "device-shows-itself")
        page = f"admin/enrollment/device/{device['id']}/review/"
        admin.open(page)
        admin.page.fill("#reason", "which of the two is it")
        with admin.page.expect_navigation():
            admin.press(admin.page.get_by_role("button", name="Suspend"))
        expect(admin.page.get_by_role("button", name="Only to show itself")).to_be_visible()
        admin.page.fill("#reason", "which of the two is it")
        with admin.page.expect_navigation():
            admin.press(admin.page.get_by_role("button", name="Only to show itself"))
        expect(admin.page.get_by_text("for no more").first).to_be_visible()
        shoot(admin, "admin-device-only-showing")
        for act in ("Suspend", "Admit"):
            admin.page.fill("#reason", "seen")
            with admin.page.expect_navigation():
                admin.press(admin.page.get_by_role("button", name=act, exact=True))
