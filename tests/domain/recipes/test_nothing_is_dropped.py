"""What a recipe or a graph says is done, told in a note, or refused for its own reason.

The rig is the bench of `test_recipe_plan`.
"""

from __future__ import annotations

import json
from typing import Any

import pytest

from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.on_rig.binding import RigBinding
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.on_rig.making import Making
from labweb.domain.recipes.on_rig.steps.conditions import start_stir
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicKind, BasicOperation
from labweb.domain.recipes.xdl.file_format.findings import Findings
from tests.domain.recipes.plans import bench, claims, compiled, reasons, recipe

ADD = 'Add vessel="reactor" reagent="water" volume="20 mL"'
FILL = 'Add vessel="filter" reagent="water" volume="20 mL"'
WARM = 'HeatChill vessel="reactor" temp="50 °C" time="1 h"'


def saying(key: str, **said: object) -> dict[str, Any]:
    graph = bench()
    next(node for node in graph["nodes"] if node["id"] == key).update(said)
    return graph


def joined(key: str, class_: str, vessel: str = "reactor") -> dict[str, Any]:
    graph = bench()
    graph["nodes"].append({"id": key, "class": class_})
    graph["links"].append({"id": key, "source": key, "target": vessel, "port": "(,)"})
    return graph


def declaring(**said: str) -> str:
    values = " ".join(f'{name}="{value}"' for name, value in said.items())
    return recipe(ADD).replace('<Reagent id="water"/>', f'<Reagent id="water" {values}/>')


@pytest.mark.parametrize("label", ["hydrogen", "H2"])
def test_hydrogen_of_a_flask_is_let_into_a_vessel(label: str) -> None:
    step = 'Purge vessel="filter" time="1 min" gas="hydrogen"'
    plan = compiled(recipe(step), saying("flask_argon", chemical=label))
    assert claims(plan, "gas")[0]["gas"] == "flask_argon"


def test_a_gas_that_the_settings_of_a_flask_say_is_a_gas() -> None:
    graph = saying("flask_argon", chemical="", config={"chemical": "argon"})
    plan = compiled(recipe('Purge vessel="filter" time="1 min"'), graph)
    assert claims(plan, "gas")[0]["gas"] == "flask_argon"


def test_a_reactor_that_is_labelled_with_a_gas_is_no_source_of_it() -> None:
    plan = compiled(recipe(ADD), saying("reactor", chemical="nitrogen"))
    assert claims(plan, "transfer")[0]["to"] == "reactor"


@pytest.mark.parametrize(
    "step",
    [
        'Stir vessel="reactor" time="1 h" stir_speed="0 RPM"',
        'Microwave vessel="reactor" temp="120 °C" time="1 min" power="0 W"',
        'Irradiate vessel="reactor" time="1 min" color="blue" LED_power="0 W" stir="false"',
    ],
)
def test_a_speed_or_power_of_nothing_is_refused_for_that(step: str) -> None:
    class_ = {"Microwave": "Microwave", "Irradiate": "Lamp"}.get(step.partition(" ")[0], "Camera")
    assert reasons(recipe(ADD, step), joined("device", class_)) == ["unit.not_positive"]


@pytest.mark.parametrize(
    "said",
    [
        {"max_temp": "hot"},
        {"min_temp": [18]},
        {"min_temp": 100, "max_temp": 20},
        {"max_temp": 90, "config": {"max_temp": 60}},
    ],
)
def test_a_limit_of_a_device_that_is_none_is_refused(said: dict[str, object]) -> None:
    assert "graph.bad_value" in reasons(recipe(ADD, WARM), saying("heater", **said))


def test_a_limit_that_is_written_as_text_is_one() -> None:
    plan = compiled(recipe(ADD, WARM), saying("heater", min_temp="18", max_temp="90.0"))
    assert claims(plan, "heat")[0]["temperature_c"] == 50.0


@pytest.mark.parametrize(
    "said", [{"chemical": ["water"]}, {"chemical": "water", "config": {"chemical": "ether"}}]
)
def test_a_label_that_is_no_text_or_two_is_refused(said: dict[str, object]) -> None:
    assert "graph.bad_value" in reasons(recipe(ADD), saying("flask_water", **said))


@pytest.mark.parametrize(
    ("step", "words"),
    [
        ('Filter vessel="filter" volume="5 mL"', "volume_ml = 5"),
        ('SwitchArgon vessel="filter" pressure="high"', "level = high"),
    ],
)
def test_what_no_device_heeds_is_a_note_with_its_line(step: str, words: str) -> None:
    notes = compiled(recipe(FILL, step), bench())["notes"]
    name = step.partition(" ")[0]
    assert f"{name} in line 1: nothing of this rig heeds {words}" in notes


def test_the_cooling_of_a_lamp_is_a_note() -> None:
    step = 'Irradiate vessel="reactor" time="1 min" color="blue" cooling_power="50 %"'
    notes = compiled(recipe(ADD, step), joined("lamp", "Lamp"))["notes"]
    assert any("cooling_percent = 50" in note for note in notes)


def test_a_pressure_that_no_device_sets_is_a_note() -> None:
    step = 'Dry vessel="filter" pressure="5 mbar" time="1 h"'
    wanted = "Dry: the vacuum of vacuum on filter is as it is, and no device sets it to 5 mbar"
    assert wanted not in compiled(recipe(FILL, step), bench())["notes"]
    graph = bench()
    graph["nodes"] = [node for node in graph["nodes"] if node["id"] != "pump_vacuum"]
    graph["links"] = [link for link in graph["links"] if link["source"] != "pump_vacuum"]
    assert wanted in compiled(recipe(FILL, step), graph)["notes"]


@pytest.mark.parametrize(
    "said",
    [
        {"temp": "-78 °C"},
        {"atmosphere": "argon"},
        {"stir": "true"},
        {"clean_with": "ether"},
        {"incompatible_reagents": "ether"},
        {"purity": "90 %"},
    ],
)
def test_what_is_declared_of_a_reagent_and_not_done_is_a_note(said: dict[str, str]) -> None:
    (name,) = said
    assert compiled(declaring(**said), bench())["notes"] == [
        f"water in line 1: the recipe says {name}, which no plan does"
    ]


def test_cleaning_that_a_recipe_leaves_to_its_platform_is_a_note() -> None:
    said = '<Synthesis auto_clean="true" organic_cleaning_solvent="ether" id="x">'
    text = recipe(ADD).replace("<Synthesis>", said)
    wanted = "the recipe says auto_clean, organic_cleaning_solvent, which no plan does"
    assert compiled(text, bench())["notes"] == [wanted]
    assert compiled(text.replace("true", "false"), bench())["notes"] == [
        wanted.replace("auto_clean, ", "")
    ]


def test_of_a_reagent_that_is_not_used_nothing_is_told() -> None:
    text = recipe(ADD).replace('<Reagent id="ether"/>', '<Reagent id="ether" temp="5 °C"/>')
    assert compiled(text, bench())["notes"] == []


def test_what_is_added_at_the_last_minute_is_refused_and_not_left_out() -> None:
    assert reasons(declaring(last_minute_addition="ether"), bench()) == ["plan.not_compiled"]


def test_what_is_called_after_steps_beside_is_a_note() -> None:
    text = recipe(ADD).replace(f"<{ADD}/>", f'<Async pid="a" on_finish="tell"><{ADD}/></Async>')
    assert (
        "Async in line 1: the recipe says on_finish, which no plan does"
        in (compiled(text, bench())["notes"])
    )


def test_a_vessel_that_is_bound_to_nothing_is_told_where_nobody_has_told_it() -> None:
    rig = read_rig(json.dumps(bench()).encode())
    binding = RigBinding(vessels={}, reagents={})
    making = Making(equipment=Equipment(rig), binding=binding, told=Findings())
    stir = BasicOperation(kind=BasicKind.START_STIR, fields={"vessel": "reactor"})
    start_stir(making, stir)
    assert [one.code for one in making.told.all] == ["plan.no_vessel"]
    assert making.steps == []
