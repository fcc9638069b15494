"""From the sign-in page to water in the reactor, and back to where the water came from."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from zipfile import ZipFile

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Visit
from tests.e2e.visitor import Visitor, plain
from tests.system.joining import until
from tests.system.stack import Stack, is_over

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

WATER = "Move 5 mL of water"
STROKES = [b"A3000R", b"A0R"]
"""The full 5 mL syringe has 3000 steps: plunger down, plunger up."""


def strokes_sent(stack: Stack) -> list[bytes]:
    """Return the plunger moves that crossed the line of pump 1, oldest first."""
    sent = b"".join(data for direction, data in stack.tap("line0.tty") if direction == "in")
    frames = [frame for frame in sent.split(b"\r") if frame]
    return [move for frame in frames for move in STROKES if frame.endswith(move)]


def shows(visitor: Visitor, key: str, volume_ul: float) -> bool:
    """Tell whether the tree of the lab shows this volume, to the decimals that it has."""
    figure, unit = visitor.read_volume(key).split()
    return (figure, unit) == (f"{volume_ul / 1000:.{len(figure.partition('.')[2])}f}", "mL")


def test_water_moves_within_eight_presses_of_the_sign_in_page(visit: Visit, stack: Stack) -> None:
    before = len(strokes_sent(stack))
    chemist = visit(None)
    chemist.open("login")
    chemist.sign_in(stack, "chemist")
    chemist.press(chemist.page.get_by_role("link", name=WATER, exact=True).last)
    chemist.press("run")
    chemist.press("start-run")
    chemist.page.wait_for_url("**/runs/*")
    expect(chemist.at("run")).to_have_attribute("data-state", "running", timeout=30_000)
    assert chemist.presses <= 8
    chemist.wait_for_state("complete", 90)
    assert strokes_sent(stack)[before:] == STROKES
    expect(chemist.at("run-state")).to_contain_text("Complete")


def test_the_pages_say_what_the_bench_holds_and_where_it_came_from(
    visit: Visit, stack: Stack
) -> None:
    keys = stack.keys()
    before = stack.volumes_ul()["reactor_1"]
    run = stack.client().start(WATER)
    chemist = visit("chemist")
    chemist.open(f"runs/{run['id']}")
    chemist.wait_for_state("complete", 90)
    chemist.go_to("Lab")
    chemist.page.wait_for_url("**/lab")
    really = stack.volumes_ul()
    assert really["reactor_1"] == pytest.approx(before + 5000, abs=1)
    for vessel in ("reactor_1", "water"):
        until(partial(shows, chemist, keys[vessel], really[vessel]))
    chemist.press(chemist.page.get_by_role("treeitem").filter(has_text="Reactor 1"))
    expect(chemist.at("resource")).to_contain_text("W-0001")
    chemist.press("lineage-link")
    table = chemist.at("lineage-table")
    row = table.get_by_role("row").filter(has_text="Water").first
    expect(row).to_be_visible()
    expect(table).to_contain_text("W-0001")
    assert "Reactor 1" in plain(table.inner_text())


def test_the_lab_is_shown_as_it_was(visit: Visit, stack: Stack) -> None:
    reactor = stack.keys()["reactor_1"]
    chemist = visit("chemist")
    chemist.open(f"lab?sel={reactor}")
    chemist.at("resource").wait_for()
    before = chemist.read_volume(reactor)
    moment = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    run = stack.client().start(WATER)
    stack.client().wait_for_run(run["id"], is_over, 90)
    row = chemist.page.locator(f"[data-testid=tree-row][data-resource='{reactor}'] .volcell")
    expect(row).not_to_have_text(re.compile(rf"^{re.escape(before.split()[0])}\b"))
    chemist.open(f"lab?sel={reactor}&at={moment}")
    chemist.at("past-resource").wait_for()
    assert chemist.read_volume(reactor) == before
    chemist.press("back-to-now")
    chemist.at("resource").wait_for()
    assert chemist.read_volume(reactor) != before
    chemist.open("lab?at=2001-01-01T00:00:00Z")
    expect(chemist.page.get_by_role("alert")).to_contain_text("import")


def test_a_run_and_a_lineage_can_be_taken_away_as_files(visit: Visit, stack: Stack) -> None:
    run = stack.client().start(WATER)
    chemist = visit("chemist")
    chemist.open(f"runs/{run['id']}")
    chemist.wait_for_state("complete", 90)
    chemist.press("export")
    with chemist.page.expect_download() as crate:
        chemist.press("crate")
    with ZipFile(crate.value.path()) as packed:
        described = json.loads(packed.read("ro-crate-metadata.json"))["@graph"]
    assert {"workflow.json", "plan.json"} <= {entity["@id"] for entity in described}
    reactor = stack.keys()["reactor_1"]
    asked = stack.client().raw("GET", f"resources/{reactor}/provenance?form=prov")
    assert asked.status_code == 200, asked.text
    chemist.open(f"lineage/{reactor}")
    chemist.at("lineage-table").wait_for()
    with chemist.page.expect_download() as document:
        chemist.press("prov")
    told = json.loads(Path(document.value.path()).read_text())
    assert any("W-0001" in json.dumps(entity) for entity in told["entity"].values())
    chemist.open("lab")
    chemist.press("export")
    with chemist.page.expect_download() as contents:
        chemist.press("export-contents")
    assert "W-0001" in Path(contents.value.path()).read_text()


def test_the_twin_shows_inside_the_run_page(visit: Visit, stack: Stack) -> None:
    chemist = visit("chemist")
    runs = stack.client().get("runs?limit=1")["runs"] or [stack.client().start(WATER)]
    chemist.open(f"runs/{runs[0]['id']}")
    expect(chemist.at("twin")).to_have_attribute("data-state", "live", timeout=30_000)
    assert stack.client().get("twin")["state"] == "online"
    scene = chemist.at("twin").frame_locator("iframe")
    expect(scene.locator("canvas").first).to_be_visible(timeout=60_000)
