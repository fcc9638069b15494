"""A published station of Uni-Lab-OS: a workflow is drawn on it by mouse, and runs to its end."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.corpus import GRAPHS, NO_GRAPHS
from tests.e2e.drawing import (
    draft,
    field,
    new_workflow,
    wait_until_checked,
    wait_until_saved,
    write,
)
from tests.e2e.pictures import shoot
from tests.e2e.visitor import Visitor, visiting
from tests.system.stack import Stack, running

STATION = GRAPHS / "comprehensive_protocol" / "comprehensive_station.json"
SPEED = 200.0

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
    pytest.mark.skipif(not STATION.is_file(), reason=NO_GRAPHS),
]


@pytest.fixture(scope="module")
def station() -> Iterator[Stack]:
    folder = Path(tempfile.mkdtemp(prefix="le-", dir="/tmp"))
    try:
        with running(folder / "lab", lab=STATION, speed=SPEED) as stack:
            stack.wait_until_online()
            yield stack
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def choose(visitor: Visitor, name: str, choice: str) -> None:
    """Choose a resource with the mouse: open the list, press the line."""
    visitor.press(field(visitor, name))
    visitor.press(visitor.page.get_by_role("option", name=choice, exact=False).first)


def call(visitor: Visitor, device: str, action: str) -> None:
    """Add an action of a device: open the device where it is shut, press the action."""
    palette = visitor.at("palette")
    group = palette.get_by_role("button", name=device)
    if group.get_attribute("aria-expanded") == "false":
        visitor.press(group)
    visitor.press(palette.get_by_role("button", name=action).last)


def test_a_workflow_with_heat_stirring_and_vacuum_is_drawn_by_mouse_and_runs(
    station: Stack, chromium: Browser
) -> None:
    before = station.volumes_ul()
    with visiting(chromium, station, "chemist") as chemist:
        workflow = new_workflow(chemist, "Warm and stir under reduced pressure")
        for source, volume in (("reagent_bottle_1", "10 mL"), ("reagent_bottle_4", "5 mL")):
            chemist.press("add-transfer")
            choose(chemist, "source", named(station, source))
            choose(chemist, "target", named(station, "main_reactor"))
            write(chemist, "volume", volume)
        chemist.press("add-heat_chill")
        choose(chemist, "vessel", named(station, "main_reactor"))
        write(chemist, "temperature", "40 °C")
        chemist.press("add-stir")
        choose(chemist, "vessel", named(station, "main_reactor"))
        write(chemist, "stir_speed", "300 rpm")
        write(chemist, "duration", "2 min")
        call(chemist, named(station, "vacuum_pump_1"), "Evacuate to")
        form = chemist.at("inspector")
        form.get_by_label("Pressure").fill("60")
        form.get_by_label("Tolerance").fill("5")
        call(chemist, named(station, "vacuum_pump_1"), "Vent")
        wait_until_checked(chemist)
        wait_until_saved(chemist)
        expect(chemist.at("no-findings")).to_be_visible()
        drawn = draft(station, workflow)
        kinds = ["transfer", "transfer", "heat_chill", "stir", "device_action", "device_action"]
        assert [step["kind"] for step in drawn["steps"]] == kinds
        assert len(drawn["edges"]) == len(kinds) - 1
        shoot(chemist, "editor-published-station", is_whole=False)
        chemist.press("run")
        chemist.press("start-run")
        chemist.page.wait_for_url("**/runs/*")
        chemist.wait_for_state("complete", 150)
        assert not chemist.complaints
    after = station.volumes_ul()
    assert after["main_reactor"] - before.get("main_reactor", 0.0) == pytest.approx(15_000, abs=20)
    taken = before["reagent_bottle_1"] - after["reagent_bottle_1"]
    assert taken == pytest.approx(10_000, abs=20)


def named(stack: Stack, key: str) -> str:
    """Return what the lab calls a resource."""
    rows = stack.client().get("resources")["resources"]
    return next(str(row["name"]) for row in rows if row["key"] == key)
