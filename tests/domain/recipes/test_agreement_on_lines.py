"""A workflow takes the pumps of its plan, in its order, where what is left in lines counts."""

from __future__ import annotations

import json
from typing import Any

from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.agreement.check import check_agreement
from labweb.domain.recipes.recipe_preview import PreviewAsked, open_recipe, workflow_from
from tests.domain.recipes.plans import recipe, unproved
from tests.domain.recipes.test_agreement import (
    DECLARED_RAW,
    GRAPH,
    REACTOR,
    SYNTHESIS,
)
from tests.domain.recipes.test_opening import STARTER

PUMPS = ("pump_1", "pump_2")


def with_edges(found: dict[str, Any], *gone: str) -> dict[str, Any]:
    """Take away what a step waits for."""
    return found | {"edges": [edge for edge in found["edges"] if edge["target"] not in gone]}


def keeping_apart() -> tuple[dict[str, Any], dict[str, Any]]:
    """Return plan and workflow of two liquids that must not meet, each by a pump of its own."""
    lab = json.loads(STARTER)
    acid = next(one for one in lab["materials"] if one["key"].startswith("hydrochloric"))
    acid["incompatible_with"] = ["dye"]
    one = 'Add vessel="reactor" reagent="acid" volume="2 mL"'
    two = 'Add vessel="flask" reagent="dye" volume="2 mL"'
    hardware = REACTOR + '<Component id="flask" type="flask"/>'
    asked = PreviewAsked(
        name="apart",
        recipe=recipe(one, two, hardware=hardware, reagents=("acid", "dye")).encode(),
        graph=json.dumps(lab).encode(),
        bind={"acid": "acid", "dye": "dye", "reactor": "reactor_1", "flask": "flask_1"},
    )
    return open_recipe(asked)["plan"], workflow_from(asked)["document"]


def test_what_must_not_meet_goes_through_the_pumps_of_the_plan_in_its_order() -> None:
    plan, found = keeping_apart()
    assert plan["keeps_apart"] is True
    assert [step["params"]["pump"] for step in found["steps"]] == ["@pump_1", "@pump_2"]
    assert check_agreement(plan, found, PUMPS) == []
    (told,) = check_agreement(plan, with_edges(found, "s2"), PUMPS)
    assert (told.subject, told.context["before"]) == ("s2", "s1")
    found["steps"][1]["params"].pop("pump")
    (told,) = check_agreement(plan, found, PUMPS)
    assert "the plan takes pump_2, the workflow any that reaches" in told.message


def test_the_verifier_asks_a_plan_to_say_that_some_lots_must_not_meet() -> None:
    plan, _ = keeping_apart()
    lab = json.loads(STARTER)
    acid = next(one for one in lab["materials"] if one["key"].startswith("hydrochloric"))
    acid["incompatible_with"] = ["dye"]
    del plan["keeps_apart"]
    for step in plan["steps"]:
        del step["route"]
    told = unproved(plan, read_rig(json.dumps(lab).encode()))
    assert [(one.code, one.subject) for one in told] == [("interpret.chemistry", "keeps_apart")]


def test_layers_are_drawn_by_the_pump_whose_syringe_was_rinsed() -> None:
    asked = PreviewAsked(
        name="rinsed",
        recipe=SYNTHESIS,
        graph=GRAPH,
        declared=DECLARED_RAW,
        rinse=("tetrahydrofuran",),
    )
    found = workflow_from(asked)["document"]
    assert any(step["id"].startswith("rinse") for step in found["steps"])
    drawn = [step["params"]["pump"] for step in found["steps"] if step["kind"] == "separate"]
    assert drawn == ["@pump_2"] * 3
