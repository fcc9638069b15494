"""Rinsing and blowing out lines that an acid wets, on a rig whose aqueous waste holds a cyanide."""

from __future__ import annotations

from typing import Any

from labweb.domain.recipes.recipe_to_plan import CompileWish
from tests.domain.recipes.plans import claims, compiled
from tests.domain.recipes.test_rinses import CHLORIDE, add, rinses
from tests.domain.recipes.test_wastes import GROUPS, refused, text, two_wastes

RESET = 'ResetHandling solvent="water" volume="5 mL" repeats="1"'
PURGE = "PurgeBackbone"
WISH = CompileWish(groups={lot: words for lot, words in GROUPS.items() if lot != "acetone"})


def rig(*cyanides: str) -> dict[str, Any]:
    graph = two_wastes({})
    for node in graph["nodes"]:
        if node["id"] in cyanides:
            node |= {"chemical": "NaCN", "current_volume": 50, "groups": ["cyanide"]}
        if node["id"] == "flask_acetone":
            node["chemical"] = "argon"
    return graph


def wet(*steps: str) -> str:
    return text(add("acid"), *steps).replace('<Reagent id="acetone"/>', "")


def test_a_rinse_goes_into_no_waste_that_must_not_get_what_wets_the_lines() -> None:
    clean = compiled(wet(RESET), rig(), WISH)
    assert rinses(clean) == [("water", "waste_aqueous")]
    assert rinses(compiled(wet(RESET), rig("waste_aqueous"), WISH)) == [("water", "waste_organic")]
    found = refused(wet(RESET), rig("waste_aqueous", "waste_organic"), WISH)
    assert [one.code for one in found] == ["plan.incompatible"]
    assert "acid must not meet NaCN" in found[0].message


def test_what_the_solvent_must_not_meet_is_washed_out_before_it() -> None:
    steps, graph = text(add("acid"), RESET), two_wastes({})
    plan = compiled(steps, graph, CompileWish(groups=CHLORIDE, rinse=("acetone",)))
    assert [lot for lot, _ in rinses(plan)] == ["acetone"] * 3 + ["water"]
    found = refused(steps, graph, CompileWish(groups=CHLORIDE))
    assert [one.code for one in found] == ["plan.no_rinse"]


def test_gas_blows_what_wets_the_lines_into_no_waste_that_must_not_get_it() -> None:
    both = compiled(wet(PURGE), rig(), WISH)
    assert [does["to"] for does in claims(both, "flush")] == ["waste_aqueous", "waste_organic"]
    plan = compiled(wet(PURGE), rig("waste_aqueous"), WISH)
    assert [does["to"] for does in claims(plan, "flush")] == ["waste_organic"]
    assert any("into waste_aqueous: acid must not meet NaCN" in note for note in plan["notes"])
    found = refused(wet(PURGE), rig("waste_aqueous", "waste_organic"), WISH)
    assert [one.code for one in found] == ["plan.incompatible"] * 2
