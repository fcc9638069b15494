"""When nobody knows what the pump did, the page asks a person and believes nothing else."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import Visit
from tests.e2e.drawing import add, new_workflow, pick, run_it
from tests.e2e.pictures import SCREENS, shoot
from tests.e2e.visitor import Visitor
from tests.system.stack import Stack

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

ANSWERS = ["It happened", "It did not", "Partly", "I cannot tell"]


def answer(visitor: Visitor, kind: str, note: str, amount_ml: str = "") -> None:
    """Answer the card that asks."""
    card = visitor.at("resolve-card").first
    visitor.press(card.get_by_test_id(f"answer-{kind}"))
    if amount_ml:
        card.get_by_test_id("answer-amount").fill(amount_ml)
    card.get_by_test_id("answer-note").fill(note)
    visitor.press(card.get_by_test_id("answer-send"))


def test_a_muted_pump_stops_the_page_and_a_person_answers(visit: Visit, stack: Stack) -> None:
    keys = stack.keys()
    params = {"source": keys["water"], "target": keys["reactor_1"], "volume": "5 mL"}
    chemist = visit("chemist")
    run = stack.client().start_step("transfer", {**params, "flow_rate": "2 mL/min"})
    chemist.open(f"runs/{run['id']}")
    stack.client().wait_for_run(run["id"], is_drawing)
    with stack.silent("pump_1"):
        chemist.at("resolve-card").wait_for(timeout=90_000)
        chemist.wait_for_state("paused")
        done = chemist.page.locator("[data-testid^=run-step-][data-state=done]")
        expect(done).to_have_count(0)
        chemist.page.wait_for_timeout(2000)
        expect(chemist.at("run")).to_have_attribute("data-state", "paused")
        expect(chemist.at("run-state")).not_to_contain_text("Complete")
    stack.wait_until_online()
    card = chemist.at("resolve-card").first
    expect(card.get_by_test_id("doubt-measured")).to_contain_text(
        "5.000 \N{MINUS SIGN} 0.000 = 5.000 mL moved", timeout=60_000
    )
    expect(card.get_by_test_id("answer-happened")).to_be_checked()
    chemist.press(card.get_by_test_id("answer-did_not"))
    card.get_by_test_id("answer-note").fill("nothing in the tube")
    expect(card.get_by_test_id("answer-against")).to_be_visible()
    expect(card.get_by_test_id("answer-send")).to_be_disabled()
    answer(chemist, "happened", "the plunger stands at 5 mL")
    chemist.wait_for_state("complete", 90)
    chemist.press(chemist.at("tab-events"))
    expect(chemist.at("event-resolved").first).to_contain_text("it happened")
    expect(chemist.page.get_by_text("In doubt", exact=True)).to_have_count(0)
    shoot(chemist, "doubt-resolved", is_whole=False)
    chemist.press(chemist.at("tab-report"))
    expect(chemist.at("report-doubts")).to_contain_text("it happened")


def see_choices(visitor: Visitor, name: str) -> None:
    """See that every choice stands on the screen without scrolling; keep pictures."""
    page = visitor.page
    for width, height in ((1440, 900), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        page.evaluate("window.scrollTo(0, 0)")
        page.wait_for_timeout(300)
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
            page.wait_for_timeout(100)
            page.screenshot(path=SCREENS / f"{name}-{width}-{scheme}.png", animations="disabled")
        page.emulate_media(color_scheme="light")
        hidden = page.evaluate(_HIDDEN)
        assert hidden == [], f"out of sight at {width}: {hidden}"
    page.set_viewport_size({"width": 1440, "height": 900})


_HIDDEN = """[...document.querySelectorAll('[data-testid=resolve-card] input[type=radio]')]
    .filter((one) => {
        const box = one.getBoundingClientRect();
        const top = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
        return !(top && (top === one || one.closest('label').contains(top)));
    })
    .map((one) => one.dataset.testid)"""


def is_drawing(run: dict[str, Any]) -> bool:
    """Tell whether the pump draws liquid now."""
    return any(job["action"] == "aspirate" and job["state"] == "running" for job in run["jobs"])


def test_a_pump_that_falls_silent_half_way_is_answered_in_five_presses(
    visit: Visit, stack: Stack
) -> None:
    keys = stack.keys()
    chemist = visit("chemist")
    run = stack.client().start("Try an error")
    chemist.open(f"runs/{run['id']}")
    card = chemist.at("resolve-card")
    card.wait_for(timeout=120_000)
    expect(card).to_contain_text("Was 4.00 mL moved")
    for words in ANSWERS:
        expect(card.get_by_role("radio", name=re.compile(f"^{words}"))).to_be_visible()
    answers = card.get_by_role("radiogroup").get_by_role("radio")
    expect(answers).to_have_count(len(ANSWERS))
    expect(chemist.page.get_by_text(re.compile("retry", re.IGNORECASE))).to_have_count(0)
    expect(card.get_by_test_id("answer-send")).to_be_disabled()
    expect(card.get_by_test_id("doubt-measured")).to_contain_text("The plunger stood at")
    expect(card.get_by_test_id("answer-partly")).to_be_checked(timeout=60_000)
    expect(card.get_by_test_id("answer-amount")).to_have_value("2.000")
    see_choices(chemist, "doubt")
    chemist.presses = 0
    # A run that waits for a decision keeps what it holds, and the syringe is to be emptied.
    chemist.press(card.get_by_test_id("then-abort"))
    answer(chemist, "partly", "read the plunger scale", "2")
    assert chemist.presses <= 5
    expect(card).to_have_count(0, timeout=60_000)
    chemist.go_to("Lab")
    chemist.page.wait_for_url("**/lab")
    for vessel in ("flask_2", "pump_2"):
        shown = chemist.page.locator(f"[data-resource='{keys[vessel]}'] .volcell")
        expect(shown).to_have_text(re.compile(r"^2\.00\s*mL$"))

    new_workflow(chemist, "Empty pump 2")
    add(chemist, "Empty the syringe")
    pick(chemist, "pump", "Pump 2")
    pick(chemist, "target", "Waste")
    run_it(chemist)
    chemist.wait_for_state("complete", 90)
    chemist.go_to("Lab")
    held = chemist.page.locator(f"[data-resource='{keys['pump_2']}'] .volcell")
    expect(held).to_have_text(re.compile(r"^0(\.0+)?\s*[mµ]L$"))
    assert stack.volumes_ul()["flask_2"] == pytest.approx(2000, abs=5)
