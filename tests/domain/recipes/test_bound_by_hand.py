"""What a person binds or states wins, is told where the rig says another, or is refused.

The rig is the bench of `test_recipe_plan`.
"""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.errors import LabError
from labweb.domain.recipes.recipe_to_plan import CompileWish
from tests.domain.recipes.plans import bench, claims, compiled, reasons, recipe

ADD = 'Add vessel="reactor" reagent="water" volume="60 mL"'
FLASKS = '<Component id="a" type="flask"/><Component id="b" type="flask"/>'
ML = 1_000_000


def saying(key: str, **said: object) -> dict[str, Any]:
    graph = bench()
    next(node for node in graph["nodes"] if node["id"] == key).update(said)
    return graph


def test_a_reagent_that_is_bound_to_the_flask_of_another_is_taken_from_it_and_told() -> None:
    plan = compiled(recipe(ADD), bench(), CompileWish(bind={"water": "flask_ether"}))
    assert claims(plan, "transfer")[0]["from"] == "flask_ether"
    (note,) = plan["notes"]
    assert note.startswith("water is flask_ether, as chosen by hand")
    assert note.endswith("say ether")


def test_a_vessel_that_is_bound_to_a_flask_with_a_label_is_told() -> None:
    move = 'Transfer from_vessel="a" to_vessel="b" volume="5 mL"'
    wish = CompileWish(
        bind={"a": "flask_ether", "b": "flask_spare"},
        holds_nl={"flask_ether": {"ether": 9 * ML}},
    )
    plan = compiled(recipe(move, hardware=FLASKS), bench(), wish)
    assert any(note.startswith("a is flask_ether, as chosen by hand") for note in plan["notes"])


@pytest.mark.parametrize("bound", [{"water": "flask_water"}, {"water": "flask_spare"}, {}])
def test_a_flask_that_says_the_same_or_nothing_is_bound_without_a_note(
    bound: dict[str, str],
) -> None:
    assert compiled(recipe(ADD), bench(), CompileWish(bind=bound))["notes"] == []


@pytest.mark.parametrize("role", ["water", "reactor"])
@pytest.mark.parametrize("key", ["pump_1", "valve_1", "heater", "vacuum", "flask_argon"])
def test_what_is_bound_to_no_vessel_for_liquid_is_refused_and_never_left_out(
    role: str, key: str
) -> None:
    with pytest.raises(LabError) as caught:
        compiled(recipe(ADD), bench(), CompileWish(bind={role: key}))
    (finding,) = caught.value.findings
    assert finding.code == "plan.not_a_vessel"
    assert finding.context["vessel"] == key
    assert finding.context["line"] == 1


def test_what_lines_are_cleaned_with_is_not_bound_to_a_pump_either() -> None:
    cleaning = '<Reagent id="ether" use_for_cleaning="true"/>'
    text = recipe(ADD).replace('<Reagent id="ether"/>', cleaning)
    assert reasons(text, bench(), CompileWish(bind={"ether": "pump_1"})) == ["plan.not_a_vessel"]


def test_a_cleaning_solvent_that_the_rig_does_not_have_is_told_to_rinse_nothing() -> None:
    text = recipe(ADD).replace(
        '<Reagent id="ether"/>', '<Reagent id="acetone" use_for_cleaning="true"/>'
    )
    notes = compiled(text, bench())["notes"]
    assert any("no flask of the rig holds acetone" in note for note in notes)


def test_two_vessels_that_are_bound_to_one_are_told_to_be_one() -> None:
    steps = [f'Add vessel="{vessel}" reagent="water" volume="5 mL"' for vessel in "ab"]
    wish = CompileWish(bind={"a": "flask_spare", "b": "flask_spare"})
    plan = compiled(recipe(*steps, hardware=FLASKS), bench(), wish)
    assert plan["notes"] == ["a and b are one vessel of the rig, flask_spare"]


def test_a_vessel_of_the_recipe_is_no_flask_that_a_reagent_comes_out_of() -> None:
    steps = (
        'Transfer from_vessel="a" to_vessel="b" volume="5 mL"',
        'Add vessel="b" reagent="water" volume="5 mL"',
    )
    wish = CompileWish(bind={"a": "flask_water", "b": "flask_spare"})
    found = reasons(recipe(*steps, hardware=FLASKS), saying("flask_water", current_volume=50), wish)
    assert found == ["plan.shared_flask"]


@pytest.mark.parametrize("key", ["reactor", "separator", "flask_water", "waste_1"])
def test_more_than_a_vessel_holds_is_not_stated_of_it(key: str) -> None:
    graph = saying(key, current_volume=600)
    with pytest.raises(LabError) as caught:
        compiled(recipe(ADD), graph)
    first = caught.value.findings[0]
    assert (first.code, first.subject) == ("plan.stated_overfull", key)
    held = CompileWish(holds_nl={key: {"ether" if key != "flask_water" else "water": 600 * ML}})
    assert reasons(recipe(ADD), bench(), held)[0] == "plan.stated_overfull"


def test_as_much_as_a_vessel_holds_may_be_in_it() -> None:
    plan = compiled(recipe(ADD), saying("flask_water", current_volume=500))
    assert claims(plan, "fill") == []


def test_less_than_nothing_is_not_in_a_vessel() -> None:
    wish = CompileWish(holds_nl={"separator": {"ether": -1}})
    assert reasons(recipe(ADD), bench(), wish) == ["unit.not_positive"]


def test_another_lot_in_the_flask_of_a_reagent_is_refused() -> None:
    wish = CompileWish(holds_nl={"flask_water": {"ether": 5 * ML, "water": 100 * ML}})
    assert reasons(recipe(ADD), bench(), wish) == ["plan.mixed_flask"]


def test_a_flask_with_a_mixture_is_no_flask_of_one_of_its_parts_unless_it_is_chosen() -> None:
    mixture = {"liquid": [["water", 100], ["ether", 5]]}
    graph = saying("flask_water", chemical="", data=mixture)
    assert reasons(recipe(ADD), graph) == ["plan.mixed_flask"]
    plan = compiled(recipe(ADD), graph, CompileWish(bind={"water": "flask_water"}))
    assert plan["notes"] == [
        "water is flask_water, as chosen by hand: the label or contents of flask_water say ether"
    ]


def test_two_reagents_in_a_flask_that_holds_one_are_told_once() -> None:
    both = 'Add vessel="reactor" reagent="ether" volume="5 mL"'
    graph = saying("flask_water", current_volume=50)
    found = reasons(recipe(ADD, both), graph, CompileWish(bind={"ether": "flask_water"}))
    assert found == ["plan.shared_flask"]
