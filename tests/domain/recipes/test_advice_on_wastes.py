"""A further waste, on the rigs of `test_wastes` and on a lab of ours: drawn, compiled, proved."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from labweb.domain.errors import Finding
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.advise.fewest_changes import Advice, advise
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.recipe_to_plan import CompileWish
from labweb.domain.recipes.xdl.file_format.read_xdl import check_document
from labweb.domain.recipes.xdl.file_format.xml_tree import parse_markup
from tests.domain.recipes.plans import claims, compiled
from tests.domain.recipes.test_meetings import POURS, TO_WASTE, starter
from tests.domain.recipes.test_meetings import asked as on_starter
from tests.domain.recipes.test_rinses import add
from tests.domain.recipes.test_wastes import (
    GROUPS,
    clean,
    poured,
    refused,
    stirred,
    text,
    two_wastes,
)

WISH = CompileWish(groups=GROUPS, rinse=("water",))


def advice(steps: str, graph: dict[str, Any], wish: CompileWish) -> Advice | list[Finding]:
    rig = read_rig(json.dumps(graph).encode())
    read, findings = check_document(
        parse_markup(steps.encode()), rig_vessels=frozenset(Equipment(rig).vessels)
    )
    assert not findings
    return advise(read, rig, wish)


def advised(
    steps: str, graph: dict[str, Any], wish: CompileWish
) -> tuple[list[str], dict[str, Any]]:
    """Return what is advised, in words, and the plan on the corrected graph."""
    assert refused(steps, graph, wish)
    found = advice(steps, graph, wish)
    assert isinstance(found, Advice), found
    assert {change["change"] for change in found.changes} <= {"add_waste", "add_valve"}
    texts = [c["text"] for c in found.changes if c["change"] == "add_waste"]
    return texts, compiled(steps, json.loads(found.graph), wish)


def test_a_stream_that_no_waste_takes_gets_one_that_says_so() -> None:
    takes = {"waste_aqueous": ["aqueous"], "waste_organic": ["organic"]}
    texts, plan = advised(text(clean("dcm")), stirred(two_wastes(takes)), WISH)
    assert len(texts) == 1
    assert "Add waste waste_more of 1000 mL that takes halogenated, at port" in texts[0]
    assert poured(plan) == ["waste_more"]


def test_two_streams_that_no_waste_takes_get_one_waste() -> None:
    takes = {"waste_aqueous": ["aqueous"], "waste_organic": ["aqueous"]}
    steps = text(clean("dcm"), clean("acetone"))
    texts, plan = advised(steps, stirred(two_wastes(takes)), WISH)
    assert ["takes halogenated, organic," in one for one in texts] == [True]
    assert poured(plan) == ["waste_more"] * 2


@pytest.mark.parametrize("takes", [{}, {"waste_aqueous": ["aqueous", "acid", "base"]}])
def test_what_must_not_meet_in_one_waste_gets_two(takes: dict[str, list[str]]) -> None:
    graph = stirred(two_wastes(takes))
    graph["nodes"] = [n for n in graph["nodes"] if n["id"] != "waste_organic"]
    graph["links"] = [n for n in graph["links"] if n["target"] != "waste_organic"]
    texts, plan = advised(text(clean("base"), clean("acid")), graph, WISH)
    assert ["takes acid, aqueous" in one for one in texts] == [bool(takes)]
    assert poured(plan) == ["waste_aqueous", "waste_more"]


def test_a_waste_that_the_recipe_names_is_not_cured_by_another() -> None:
    steps = text(clean("base"), add("acid"), TO_WASTE.format("reactor", "all"))
    found = advice(steps, stirred(two_wastes({})), WISH)
    assert isinstance(found, list)
    assert [one.code for one in found] == ["plan.no_advice"]


def test_a_lab_of_ours_gets_one_too() -> None:
    named = (
        POURS[0],
        'CleanVessel vessel="reactor_1" solvent="acid" volume="5 mL" repeats="1"',
        'CleanVessel vessel="flask_1" solvent="dye" volume="5 mL" repeats="1"',
    )
    steps, wish = on_starter(*named)
    lab = starter(["dye"])
    for one in ("reactor_1", "flask_1"):
        lab["resources"].append(
            {"key": f"stirrer_{one}", "name": one, "kind": "stirrer", "parent": "bench_1"}
        )
        ends = {"source": {"resource": f"stirrer_{one}", "port": "shaft"}}
        ends |= {"target": {"resource": one, "port": "shaft"}}
        lab["connections"].append(
            {"key": f"s_{one}", **ends, "medium": "mechanical", "is_two_way": True}
        )
    texts, plan = advised(steps, lab, replace(wish, rinse=("water",)))
    assert len(texts) == 1
    assert {does["to"] for does in claims(plan, "transfer")} >= {"waste", "waste_more"}
