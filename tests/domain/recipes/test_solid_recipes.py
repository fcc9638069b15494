"""Steps of a recipe that a workflow says by what they expand to; the rig is drawn in `solids`."""

from __future__ import annotations

import json
from typing import Any

import pytest

from labweb.domain.errors import LabError, ProtocolError
from labweb.domain.recipes.recipe_preview import PreviewAsked, workflow_from
from labweb.domain.recipes.xdl.as_workflow.recipe_to_workflow import to_workflow
from labweb.domain.recipes.xdl.file_format.read_xdl import read_xdl
from labweb.domain.recipes.xdl.lab_choices.chosen_vessels import OnRig
from labweb.domain.recipes.xdl.lab_choices.declarations_file import Declared
from labweb.domain.recipes.xdl.unfolding.unfold_recipe import unfold
from tests.domain.workflows.solids import filter_file, filter_lab, filter_raw, on, planned

_HEAD = """<XDL><Synthesis><Hardware><Component id="filter" type="filter"/>
<Component id="reactor" type="reactor"/></Hardware>
<Reagents><Reagent name="ether"/><Reagent name="water"/></Reagents><Procedure>"""
_TAIL = "</Procedure></Synthesis></XDL>"
KEYS = {"filter": "separator", "ether": "bottle_ether", "water": "bottle_water"}
STATED = Declared(keys=KEYS, waste="waste")


def recipe_of(steps: str) -> bytes:
    return (_HEAD + steps + _TAIL).encode()


def document_of(steps: str, declared: Declared = STATED) -> dict[str, Any]:
    return to_workflow(unfold(read_xdl(recipe_of(steps))), name="Solids", declared=declared)


def kinds(steps: str, declared: Declared = STATED) -> list[str]:
    return [step["kind"] for step in document_of(steps, declared)["steps"]]


ADD = '<Add vessel="filter" reagent="ether" volume="10 mL"/>'
FILTER = '<Filter vessel="filter"/>'
WASH = '<WashSolid vessel="filter" solvent="ether" volume="5 mL" repeats="2"/>'
DRY = '<Dry vessel="filter" time="10 min" pressure="100 mbar"/>'
DISSOLVE = '<Dissolve vessel="filter" solvent="ether" volume="8 mL" time="5 min"/>'
CLEAN = '<CleanVessel vessel="filter" solvent="ether" volume="10 mL" repeats="1"/>'
RECRYSTALLIZE = (
    '<Recrystallize vessel="reactor" solvent="water" solvent_volume="10 mL" '
    'dissolve_temp="60 °C" time="5 min" crystallize_temp="5 °C"/>'
)
COOLED = ("heat_chill", "stop_heat")


@pytest.mark.parametrize(
    ("steps", "wanted"),
    [
        (FILTER, ["start_stir", "filter", "stop_stir", "dry"]),
        (WASH, ["start_stir", "transfer", "wait", "filter", "stop_stir", "dry"] * 2),
        (DRY, ["dry"]),
        (DISSOLVE, ["transfer", "start_stir", "wait", "stop_stir"]),
        (CLEAN, ["start_stir", "transfer", "wait", "transfer", "stop_stir"]),
        (
            RECRYSTALLIZE,
            ["transfer", "start_stir", "heat_chill", "wait", "stop_stir", *COOLED],
        ),
        ('<StartStir vessel="filter" stir_speed="300 rpm"/>', ["start_stir", "stop_stir"]),
        ('<StopStir vessel="filter"/>' + DRY, ["dry"]),
        (
            '<HeatChillToTemp vessel="reactor" temp="40 °C" stir="false"/>'
            '<StopHeatChill vessel="reactor"/>',
            ["heat_chill", "stop_heat"],
        ),
        ('<HeatChillReturnToRT vessel="reactor" stir="false"/>', ["heat_chill", "stop_heat"]),
    ],
)
def test_a_unit_operation_becomes_the_steps_that_it_is_made_of(
    steps: str, wanted: list[str]
) -> None:
    assert kinds(steps) == wanted


def test_what_is_assumed_is_noted_at_its_step_with_its_source() -> None:
    notes = [step["note"] for step in document_of('<Dry vessel="filter"/>')["steps"]]
    assert any("time 1 h: defaults of the Chemputer" in note for note in notes)
    assert any("pressure 400 mbar" in note for note in notes)


def test_what_stays_and_what_dries_off_is_declared_step_by_step() -> None:
    stated = Declared(
        keys=KEYS,
        waste="waste",
        receivers={"filter": "crude"},
        stays=[["salt"], ["salt", "sand"]],
        dries_off=[["ether"]],
    )
    steps = document_of(ADD + FILTER + WASH + DRY, stated)["steps"]
    filters = [step["params"]["stays"] for step in steps if step["kind"] == "filter"]
    both = {"salt": "all", "sand": "all"}
    assert filters == [{"salt": "all"}, both, both]
    dried = [step["params"] for step in steps if step["kind"] == "dry"]
    assert [one.get("dries_off") for one in dried[:-1]] == [None] * 3
    assert (dried[-1]["dries_off"], dried[-1]["receiver"]) == ({"ether": "all"}, "@crude")


def test_what_nothing_stirs_on_a_rig_is_done_without_stirring() -> None:
    said = (
        '<StartStir vessel="filter" stir_speed="300 rpm"/>'
        '<Stir vessel="filter" time="1 min" stir_speed="300 rpm"/>'
        '<Dissolve vessel="filter" solvent="ether" volume="8 mL" temp="40 °C" time="1 min"/>'
    )
    acts = unfold(read_xdl(recipe_of(said)))
    rig = OnRig(unstirred=frozenset({"separator"}))
    steps = to_workflow(acts, name="still", declared=STATED, rig=rig)["steps"]
    assert not {step["kind"] for step in steps} & {"stir", "start_stir", "stop_stir"}
    assert [step["params"]["duration"] for step in steps if step["kind"] == "wait"] == [
        "60 s",
        "60 s",
    ]


def test_a_person_is_asked_and_weighs_solids_in() -> None:
    said = '<Confirm msg="Sure?"/><AddSolid vessel="filter" reagent="ether" mass="1 g"/>'
    confirmed, weighed = document_of(said, STATED)["steps"][:2]
    assert (confirmed["kind"], confirmed["params"]) == ("confirm", {"question": "Sure?"})
    assert weighed["kind"] == "add_solid"
    assert weighed["params"] == {"source": "@bottle_ether", "target": "@separator", "mass": "1 g"}


@pytest.mark.parametrize(
    ("steps", "stated", "code"),
    [
        (FILTER, Declared(keys=KEYS), "xdl.not_declared"),
        (DRY, Declared(keys=KEYS, dries_off=[["ether"]]), "xdl.not_declared"),
        (f'<Confirm msg="{"Sure? " * 40}"/>', STATED, "xdl.not_in_workflow"),
        ('<Filter vessel="filter" aspiration_speed="5 mL/min"/>', STATED, "xdl.not_in_workflow"),
        ('<Dry vessel="filter" time="1-2 h"/>', STATED, "xdl.range_not_exact"),
        (
            '<Dissolve vessel="filter" solvent="ether" volume="8 mL" temp="40 °C"/>'.replace(
                "40 °C", "reflux"
            ),
            STATED,
            "xdl.word_unresolved",
        ),
    ],
)
def test_what_a_workflow_cannot_say_is_told(steps: str, stated: Declared, code: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        document_of(steps, stated)
    assert code in {finding.code for finding in caught.value.findings}


def test_a_filtration_is_planned_and_proved_to_its_end() -> None:
    stated = Declared(keys=KEYS, waste="waste", stays=[["salt"], ["salt"]])
    plan, proof = planned(document_of(ADD + FILTER + WASH + DRY, stated), filter_lab())
    assert not proof.findings
    assert not proof.beyond
    moved = sum(job.args["volume_ul"] for job in plan.jobs if job.action == "dispense")
    assert moved == pytest.approx(2 * 20_000.0)


def test_the_workflow_does_what_the_plan_of_the_rig_is_proved_to_do() -> None:
    declared = {
        "schema": "labweb.declared/1",
        "waste": "waste",
        "keys": {"filter": "separator", "ether": "bottle_ether"},
    }
    steps = ADD + FILTER + WASH + DRY + DISSOLVE + CLEAN
    asked = PreviewAsked(
        name="Solids",
        recipe=recipe_of(steps)
        .replace(b'<Component id="reactor" type="reactor"/>', b"")
        .replace(b'<Reagent name="water"/>', b""),
        graph=filter_raw(is_plain=True),
        declared=json.dumps(declared).encode(),
    )
    try:
        document = workflow_from(asked)["document"]
    except LabError as error:
        raise AssertionError([one.message for one in error.findings]) from error
    workflow = on(document, filter_file(is_plain=True))
    assert [step.kind for step in workflow.steps].count("filter") == 3
