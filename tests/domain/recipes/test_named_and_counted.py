"""A name means one reagent, and what is done no times is refused or not done, never once.

The rig is the bench of `test_recipe_plan`.
"""

from __future__ import annotations

import pytest

from labweb.domain.errors import LabError
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicKind
from labweb.domain.recipes.xdl.expansion.expand import all_operations, expand
from labweb.domain.recipes.xdl.file_format.read_xdl import check_document
from labweb.domain.recipes.xdl.file_format.xml_tree import parse_markup
from labweb.domain.recipes.xdl.unfolding.unfold_recipe import unfold
from tests.domain.recipes.plans import bench, claims, compiled, recipe

ADD = 'Add vessel="filter" reagent="water" volume="20 mL"'


def declaring(*reagents: str) -> str:
    text = recipe('Wait time="1 s"')
    entries = "\n".join(f"<Reagent {one}/>" for one in reagents)
    return text.replace('<Reagent id="water"/><Reagent id="ether"/>', f"\n{entries}\n")


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ('id="a" name="water"', 'id="b" name="water"'),
        ('id="water" name="brine"', 'id="b" name="water"'),
        ('name="water"', 'id="b" name="water"'),
    ],
)
def test_two_reagents_of_one_name_are_told_with_both_lines(one: str, other: str) -> None:
    document = parse_markup(declaring(one, 'id="ether"', other).encode())
    (finding,) = check_document(document)[1]
    assert finding.code == "xdl.duplicate_name"
    assert "line 2," in finding.message
    assert "line 4," in finding.message
    assert finding.context["line"] == 4
    assert "'water'" in finding.message


def test_a_reagent_that_is_declared_twice_over_is_still_one() -> None:
    text = declaring('id="a" name="water"', 'id="a" name="water"', 'id="b" name="brine"')
    assert check_document(parse_markup(text.encode()))[1] == []


NEVER = (
    'CleanVessel vessel="filter" solvent="water" volume="5 mL" repeats="0"',
    'EvacuateAndRefill vessel="filter" gas="argon" repeats="0"',
    'Evacuate vessel="filter" gas="argon" repeats="0"',
    'WashSolid vessel="filter" solvent="water" volume="5 mL" repeats="0"',
    'ResetHandling solvent="water" volume="5 mL" repeats="0"',
    'AddSolid vessel="filter" reagent="salt" mass="1 g" portions="0"',
    'Separate from_vessel="filter" separation_vessel="separator" to_vessel="filter" '
    'purpose="wash" product_phase="top" solvent="ether" repeats="0"',
)


@pytest.mark.parametrize("step", NEVER, ids=lambda step: step.partition(" ")[0])
def test_what_is_to_be_done_no_times_is_refused(step: str) -> None:
    text = recipe(ADD, step, reagents=("water", "ether", "salt"))
    with pytest.raises(LabError) as caught:
        compiled(text, bench())
    (finding,) = caught.value.findings
    assert finding.code == "unit.not_positive"
    assert step.partition(" ")[0] in finding.message


def test_a_loop_of_no_rounds_does_nothing() -> None:
    text = recipe(ADD).replace(f"<{ADD}/>", f'<Repeat repeats="0"><{ADD}/></Repeat>')
    assert claims(compiled(text, bench())) == []


def test_what_is_rinsed_after_a_transfer_no_times_is_not_rinsed() -> None:
    move = (
        'Transfer from_vessel="filter" to_vessel="separator" volume="all" '
        'rinsing_solvent="ether" rinsing_volume="5 mL" rinsing_repeats="0"'
    )
    plan = compiled(recipe(ADD, move), bench())
    assert "ether" not in plan["totals"]["needed_ul"]


@pytest.mark.parametrize("times", [0, 1, 2])
def test_what_is_eluted_is_eluted_as_often_as_it_says(times: int) -> None:
    step = (
        'FilterThrough from_vessel="reactor" to_vessel="filter" through="celite" '
        f'eluting_solvent="ether" eluting_volume="5 mL" eluting_repeats="{times}"'
    )
    read, findings = check_document(parse_markup(recipe(step).encode()))
    assert not findings
    eluted = [o for o in all_operations(expand(unfold(read))) if o.kind is BasicKind.ADD_LIQUID]
    assert len(eluted) == times


def test_portions_of_a_solid_are_together_the_mass_that_is_asked_for() -> None:
    step = 'AddSolid vessel="filter" reagent="salt" mass="1 g" portions="3"'
    plan = compiled(recipe(step, reagents=("salt",)), bench())
    assert plan["totals"]["delivered_ug"] == {"filter": {"salt": 1_000_000}}
    assert [one["mass_ug"] for one in claims(plan, "add_solid")] == [333333, 333333, 333334]


@pytest.mark.parametrize(
    ("step", "code", "said"),
    [
        ('Add vessel="reactor" reagent="water" volume="1.5e-6 mL"', "off_grid", "0.0000015 mL"),
        ('Add vessel="reactor" reagent="water" amount="1.5e-6 mL"', "off_grid", "0.0000015 mL"),
        ('Add vessel="reactor" reagent="water" volume="0.5 nL"', "off_grid", "0.0000005 mL"),
        ('Add vessel="reactor" reagent="water" volume="1.0000004 mL"', "off_grid", "1.0000004 mL"),
        ('Add vessel="reactor" reagent="water" volume="0 mL"', "not_positive", "0 mL"),
        ('Add vessel="reactor" reagent="water" volume="2000 L"', "too_large", "2000000 mL"),
        ('AddSolid vessel="reactor" reagent="salt" mass="0.5 ug"', "off_grid", "0.0000005 g"),
        ('AddSolid vessel="reactor" reagent="salt" mass="1.0000004 g"', "off_grid", "1.0000004 g"),
        ('AddSolid vessel="reactor" reagent="salt" mass="0 g"', "not_positive", "0 g"),
        (
            'AddSolid vessel="reactor" reagent="salt" mass="2 ug" portions="5"',
            "off_grid",
            "0.0000004 g",
        ),
    ],
)
def test_an_amount_that_the_ledger_cannot_hold_is_refused_as_what_it_is(
    step: str, code: str, said: str
) -> None:
    with pytest.raises(LabError) as caught:
        compiled(recipe(step, reagents=("water", "salt")), bench())
    (finding,) = caught.value.findings
    assert finding.code == f"unit.{code}"
    assert said in finding.message


@pytest.mark.parametrize(
    ("moles", "volume_ul"), [("1 mmol", 18.054), ("1.0004 umol", 0.018), ("0.05 umol", 0.001)]
)
def test_what_is_worked_out_is_the_nearest_nanolitre(moles: str, volume_ul: float) -> None:
    text = recipe(f'Add vessel="reactor" reagent="water" amount="{moles}"')
    water = '<Reagent id="water" molecular_weight="18 g/mol" density="0.997 g/mL"/>'
    plan = compiled(text.replace('<Reagent id="water"/>', water), bench())
    assert plan["totals"]["delivered_ul"] == {"reactor": {"water": volume_ul}}


def test_what_is_worked_out_as_less_than_half_a_nanolitre_is_refused() -> None:
    text = recipe('Add vessel="reactor" reagent="water" amount="0.02 umol"')
    water = '<Reagent id="water" molecular_weight="18 g/mol" density="1 g/mL"/>'
    with pytest.raises(LabError) as caught:
        compiled(text.replace('<Reagent id="water"/>', water), bench())
    assert [one.code for one in caught.value.findings] == ["unit.off_grid"]
