"""A recipe in XDL from file to workflow: bound, planned, its route seen, another rig compared."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Visit
from tests.e2e.pictures import shoot
from tests.e2e.visitor import Visitor

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

STATIONS = Path(__file__).resolve().parents[2] / "fixtures/labs/three_stations"
ACETYLATION = STATIONS / "protocols/acetylation.xdl"
COMPILED_MS = 90_000
"""A recipe is compiled by a process of its own, on a machine that may be busy."""

WARM = """<XDL><Synthesis>
  <Hardware><Component id="reactor" type="reactor"/></Hardware>
  <Reagents><Reagent name="Water"/></Reagents>
  <Procedure>
    <Add vessel="reactor" reagent="Water" volume="2 mL"/>
    <HeatChillToTemp vessel="reactor" temp="40 °C" stir="false"/>
  </Procedure>
</Synthesis></XDL>
"""

DOSE = """<?xdl version="2.0.0" ?><XDL><Synthesis>
  <Hardware><Component id="reactor" type="reactor"/></Hardware>
  <Parameters><Parameter id="dose" type="volume" min="1 mL" max="20 mL"/></Parameters>
  <Reagents><Reagent name="water"/></Reagents>
  <Procedure><Add vessel="reactor" reagent="water" volume="dose"/></Procedure>
</Synthesis></XDL>
"""


def wait_for_plan(visitor: Visitor, state: str = "proved") -> None:
    expect(visitor.at("proof")).to_have_attribute("data-state", state, timeout=COMPILED_MS)


def test_a_recipe_is_opened_its_route_seen_and_it_becomes_a_workflow(
    visit: Visit, tmp_path: Path
) -> None:
    file = tmp_path / "warm water.xdl"
    file.write_text(WARM, "utf-8")
    chemist = visit("chemist")
    chemist.open("workflows")
    chemist.at("open-xdl-input").set_input_files(file)
    wait_for_plan(chemist)
    expect(chemist.page.get_by_label("reactor is").locator("option").first).to_contain_text(
        "reactor_1"
    )
    # Earlier runs may have left pure water elsewhere too.
    chemist.page.get_by_label("Water is").select_option("water")
    move = chemist.at("planned-step").filter(has_text="from water to reactor_1").first
    expect(move).to_be_visible(timeout=COMPILED_MS)
    move.locator(".pick").press("Enter")
    expect(chemist.at("route-tube").filter(has_text="reactor_1")).to_have_count(1)
    lit = chemist.page.locator(".rigbox[data-state=on]")
    assert {"water", "reactor_1"} <= {box.get_attribute("data-node") for box in lit.all()}
    move.locator(".unfold").press("Enter")
    expect(move.get_by_test_id("planned-action").filter(has_text="aspirate")).to_be_visible()
    chemist.press("save-recipe")
    chemist.press("save-confirm")
    expect(chemist.at("findings-bar")).to_have_attribute("data-state", "checked")
    expect(chemist.at("no-findings")).to_be_visible()
    assert chemist.complaints == []


def test_what_is_stated_beside_a_recipe_binds_it_and_a_name_of_nothing_is_told(
    visit: Visit, tmp_path: Path
) -> None:
    file, stated, wrong = (tmp_path / name for name in ("cold.xdl", "stated.json", "wrong.json"))
    file.write_text(WARM.replace("Water", "the solvent"), "utf-8")
    head = '{"schema": "labweb.declared/1", "keys": '
    wrong.write_text(head + '{"the solvant": "water"}}', "utf-8")
    stated.write_text(head + '{"the solvent": "water"}}', "utf-8")
    chemist = visit("chemist")
    chemist.open("workflows")
    chemist.at("open-xdl-input").set_input_files(file)
    wait_for_plan(chemist, "none")
    chemist.at("add-declared-input").set_input_files(wrong)
    expect(chemist.at("wish-declared").get_by_role("alert").first).to_contain_text(
        "the solvant", timeout=COMPILED_MS
    )
    chemist.at("add-declared-input").set_input_files(stated)
    wait_for_plan(chemist)
    bound = chemist.page.get_by_label("the solvent is")
    expect(bound.locator("option").first).to_contain_text("as stated")
    expect(chemist.at("declared-file")).to_contain_text("stated.json")
    assert chemist.complaints == []


def test_what_does_not_fit_the_lab_fits_another_rig_and_two_rigs_are_compared(
    visit: Visit,
) -> None:
    chemist = visit("chemist")
    chemist.open("workflows/xdl")
    expect(chemist.at("empty")).to_be_visible()
    chemist.at("open-xdl-input").set_input_files(ACETYLATION)
    wait_for_plan(chemist, "none")
    expect(chemist.at("recipe-steps")).to_have_count(0)
    finding = chemist.at("recipe-finding").filter(has_text="plan.no_vessel").first
    finding.get_by_role("button").click()
    line = finding.get_by_role("button").inner_text().removeprefix("Line ").partition(",")[0]
    expect(chemist.page.locator(f"[data-line='{line}']")).to_be_focused()
    chemist.at("add-graph-input").set_input_files(STATIONS / "row.json")
    wait_for_plan(chemist)
    chemist.at("add-graph-input").set_input_files(STATIONS / "wheel.json")
    wait_for_plan(chemist)
    expect(chemist.at("difference-counts")).to_contain_text("done otherwise")
    steps = chemist.page.locator("[data-testid=difference-row][data-name=Steps]")
    expect(steps).to_be_visible()
    expect(chemist.at("step-change").first).to_be_visible()
    assert chemist.complaints == []


def test_what_a_recipe_leaves_open_is_asked_for_and_checked(visit: Visit, tmp_path: Path) -> None:
    file = tmp_path / "dose.xdl"
    file.write_text(DOSE, "utf-8")
    chemist = visit("chemist")
    chemist.open("workflows/xdl")
    chemist.at("open-xdl-input").set_input_files(file)
    wait_for_plan(chemist, "none")
    dose = chemist.at("parameter-dose")
    expect(dose).to_have_attribute("aria-invalid", "true")
    dose.fill("two drops")
    dose.press("Enter")
    expect(chemist.at("wish-parameters")).to_contain_text("says no amount", timeout=COMPILED_MS)
    dose.fill("25 mL")
    dose.press("Enter")
    expect(chemist.at("wish-parameters")).to_contain_text("1 mL to 20 mL", timeout=COMPILED_MS)
    dose.fill("2.5 mL")
    dose.press("Enter")
    wait_for_plan(chemist, "none")
    # The lab's bottle is labelled "Water": nothing takes it for the recipe's "water" but a person.
    expect(chemist.at("recipe-finding").filter(has_text="holds 'Water'")).to_have_count(1)
    chemist.at("take-alike").filter(has_text="water:").press("Enter")
    wait_for_plan(chemist)
    moved = chemist.at("planned-step").filter(has_text="2.5").filter(has_text="from water")
    expect(moved.first).to_be_visible()
    primed = chemist.at("planned-step").filter(has_text="Prime")
    expect(primed).to_have_count(0)
    chemist.at("wish-primes").check()
    chemist.press("say-wishes")
    expect(primed.first).to_be_visible(timeout=COMPILED_MS)
    wait_for_plan(chemist)
    shoot(chemist, "recipe-primed")
    chemist.press("save-recipe")
    chemist.press("save-confirm")
    expect(chemist.at("findings-bar")).to_have_attribute("data-state", "checked")
    assert chemist.complaints == []
