"""What a step says in two ways agrees, or is refused; what nothing does is a note.

The rig is the bench of `test_recipe_plan`.
"""

from __future__ import annotations

from typing import Any

import pytest

from labweb.domain.errors import LabError
from labweb.domain.recipes.xdl.as_workflow.recipe_to_workflow import to_workflow
from labweb.domain.recipes.xdl.file_format.read_xdl import check_document
from labweb.domain.recipes.xdl.file_format.xml_tree import parse_markup
from labweb.domain.recipes.xdl.lab_choices.declarations_file import Declared
from labweb.domain.recipes.xdl.unfolding.unfold_recipe import unfold
from tests.domain.recipes.plans import bench, compiled, reasons, recipe

ADD = 'Add vessel="reactor" reagent="water" {said}'
FILL = 'Add vessel="reactor" reagent="water" volume="20 mL"'
MOVE = 'Transfer from_vessel="reactor" to_vessel="filter" {said}'


def adding(said: str, **facts: str) -> str:
    declared = " ".join(f'{name}="{value}"' for name, value in facts.items())
    text = recipe(ADD.format(said=said))
    return text.replace('<Reagent id="water"/>', f'<Reagent id="water" {declared}/>')


def rates(plan: dict[str, Any], action: str) -> set[float]:
    commands = [c for step in plan["steps"] for group in step["actions"] for c in group]
    return {c["parameters"]["rate_ul_s"] for c in commands if c["action"] == action}


def workflow_rate(text: str) -> str:
    read, findings = check_document(parse_markup(text.encode()))
    assert not findings
    made = to_workflow(unfold(read), name="recipe", declared=Declared())
    rate: str = made["steps"][0]["params"]["flow_rate"]
    return rate


@pytest.mark.parametrize(
    "said",
    [
        'volume="10 mL" time="10 min" speed="5 mL/min"',
        'volume="10 mL" time="10 min" dispense_speed="2 mL/min"',
        'volume="10 mL" speed="1 mL/min" dispense_speed="2 mL/min"',
    ],
)
def test_two_rates_that_differ_are_refused(said: str) -> None:
    with pytest.raises(LabError) as caught:
        compiled(adding(said), bench())
    (finding,) = caught.value.findings
    assert finding.code == "xdl.two_rates"
    assert finding.context["line"] == 1


def test_two_rates_that_differ_make_no_workflow_either() -> None:
    with pytest.raises(LabError) as caught:
        workflow_rate(adding('volume="10 mL" time="10 min" speed="5 mL/min"'))
    assert [one.code for one in caught.value.findings] == ["xdl.two_rates"]


def test_two_rates_that_are_rounded_alike_are_one() -> None:
    said = 'volume="10 mL" time="6 min" speed="1.67 mL/min"'
    assert rates(compiled(adding(said), bench()), "dispense") == {27.7777778}
    assert workflow_rate(adding(said)) == "1.67 mL/min"


def test_a_transfer_that_says_two_rates_is_refused_too() -> None:
    said = 'volume="10 mL" time="10 min" dispense_speed="5 mL/min"'
    assert reasons(recipe(FILL, MOVE.format(said=said)), bench()) == ["xdl.two_rates"]


def test_a_mass_beside_a_volume_that_are_the_same_amount_are_one() -> None:
    said = 'volume="10 mL" mass="9.98 g"'
    plan = compiled(adding(said, density="0.998 g/mL"), bench())
    assert plan["totals"]["delivered_ul"] == {"reactor": {"water": 10000.0}}
    assert plan["notes"] == []


def test_a_mass_beside_a_volume_of_another_amount_is_refused() -> None:
    found = reasons(adding('volume="10 mL" mass="5 g"', density="0.998 g/mL"), bench())
    assert found == ["xdl.two_amounts"]


def test_a_mass_beside_a_volume_that_nobody_can_compare_is_told() -> None:
    (note,) = compiled(adding('volume="10 mL" mass="5 g"'), bench())["notes"]
    assert note == "Add in line 1: the recipe says mass, which no plan does"


@pytest.mark.parametrize(("mass", "is_alike"), [("58.4 g", True), ("3 g", False)])
def test_a_mass_beside_mol_is_compared_by_the_molar_mass(mass: str, *, is_alike: bool) -> None:
    step = f'AddSolid vessel="reactor" reagent="salt" mass="{mass}" mol="1 mol"'
    text = recipe(step, reagents=("salt",))
    text = text.replace('id="salt"', 'id="salt" molecular_weight="58.443 g/mol"')
    if is_alike:
        assert compiled(text, bench())["notes"] == []
    else:
        assert reasons(text, bench()) == ["xdl.two_amounts"]


def test_mol_alone_is_weighed_and_no_note_says_otherwise() -> None:
    text = recipe('AddSolid vessel="reactor" reagent="salt" mol="1 mol"', reagents=("salt",))
    text = text.replace('id="salt"', 'id="salt" molecular_weight="58.443 g/mol"')
    assert compiled(text, bench())["notes"] == []


def test_viscous_beside_a_speed_of_drawing_is_told_to_do_nothing() -> None:
    said = 'volume="10 mL" viscous="true" aspiration_speed="8 mL/min"'
    plan = compiled(adding(said), bench())
    assert any("is_viscous" in note for note in plan["notes"])
    assert 133.333333 in rates(plan, "aspirate")


@pytest.mark.parametrize(
    ("said", "rate_ul_s"),
    [
        ('volume="1 mL" speed="0.0001 mL/h"', 2.77777778e-05),
        ('volume="0.001 mL" time="1000 h"', 2.77777778e-07),
        ('volume="1 mL" time="900 h"', 0.000308641975),
    ],
)
def test_a_very_slow_rate_is_exact(said: str, rate_ul_s: float) -> None:
    assert rates(compiled(adding(said), bench()), "dispense") == {rate_ul_s}


def test_a_rate_that_nobody_lives_to_see_the_end_of_is_refused_in_words() -> None:
    text = adding('volume="1 mL" speed="1e-12 mL/min"')
    with pytest.raises(LabError) as caught:
        compiled(text, bench())
    (finding,) = caught.value.findings
    assert finding.code == "unit.too_large"
    assert "Add with 6e+13 s" in finding.message
    assert finding.context["line"] == 1


def test_a_very_slow_rate_is_exact_in_a_workflow_too() -> None:
    assert workflow_rate(adding('volume="1 mL" time="900 h"')) == "0.000308641975 uL/s"
    assert workflow_rate(adding('volume="1 mL" time="0.5 s"')) == "2000.0 uL/s"


def test_no_workflow_is_made_of_a_time_of_nothing() -> None:
    with pytest.raises(LabError) as caught:
        workflow_rate(adding('volume="1 mL" time="0 s"'))
    assert [one.code for one in caught.value.findings] == ["unit.not_positive"]


LIGHT = 'Irradiate vessel="reactor" time="1 min" {said}'


def lit() -> dict[str, Any]:
    graph = bench()
    graph["nodes"].append({"id": "lamp", "class": "LEDLamp"})
    graph["links"].append({"id": "lamp", "source": "lamp", "target": "reactor", "port": "(,)"})
    return graph


@pytest.mark.parametrize(
    ("said", "is_one"),
    [
        ('color="blue" wavelength="450 nm"', True),
        ('color="UV365" wavelength="365 nm"', True),
        ('color="red" wavelength="0.66 um"', True),
        ('color="white"', True),
        ('color="blue" wavelength="365 nm"', False),
        ('color="white" wavelength="450 nm"', False),
        ('color="red" wavelength="609 nm"', False),
    ],
)
def test_a_colour_beside_a_wavelength_is_its_colour_or_refused(said: str, is_one: bool) -> None:
    text = recipe(FILL, LIGHT.format(said=said))
    if is_one:
        plan = compiled(text, lit())
        assert [s["does"]["color"] for s in plan["steps"] if s["does"]["kind"] == "light"]
    else:
        assert reasons(text, lit()) == ["xdl.two_lights"]


def test_all_of_a_vessel_in_a_time_needs_contents_that_are_certain() -> None:
    separate = (
        'Separate from_vessel="reactor" separation_vessel="separator" to_vessel="filter" '
        'purpose="extract" product_phase="bottom" solvent="ether" solvent_volume="20 mL"'
    )
    move = 'Transfer from_vessel="filter" to_vessel="reactor" volume="all" {said}'
    in_time = recipe(FILL, separate, move.format(said='time="10 min"'))
    assert reasons(in_time, bench()) == ["plan.uncertain_rate"]
    by_speed = recipe(FILL, separate, move.format(said='dispense_speed="2 mL/min"'))
    assert compiled(by_speed, bench())["steps"]
    certain = recipe(FILL, MOVE.format(said='volume="all" time="10 min"'))
    assert 33.3333333 in rates(compiled(certain, bench()), "dispense")
