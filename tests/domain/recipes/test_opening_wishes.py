"""What whoever opens a recipe says beside it: parameters, blueprints, contents, rinses, flasks."""

from __future__ import annotations

import json
from dataclasses import replace
from decimal import Decimal
from typing import Any

import pytest

from labweb.domain.recipes.recipe_preview import PreviewAsked, open_recipe
from labweb.domain.recipes.xdl.file_format.attribute_values import read_value, unit_of, written
from labweb.domain.recipes.xdl.tables.step_spec import Property
from tests.domain.recipes.plans import bench, recipe
from tests.domain.recipes.test_opening import STARTER, WATER, binding
from tests.domain.workflows.station import DECLARED, LAB

WITH_PARAMETERS = """<?xdl version="2.0.0" ?><XDL><Synthesis>
<Hardware><Component id="reactor" type="reactor"/></Hardware>
<Parameters>
  <Parameter id="dose" type="volume" min="1 mL" max="0.02 L"/>
  <Parameter id="warmth" type="temp" value="60 °C"/>
</Parameters>
<Reagents><Reagent name="water"/></Reagents>
<Procedure>
  <Add vessel="reactor" reagent="water" volume="dose"/>
  <HeatChill vessel="reactor" temp="warmth" time="1 min"/>
</Procedure></Synthesis></XDL>"""
BLUEPRINT = """<XDL><Blueprint id="Moisten">
<Hardware><Component id="pot" type="reactor"/></Hardware>
<Reagents><Reagent id="wet" role="solvent"/></Reagents>
<Procedure><Add vessel="pot" reagent="wet" volume="5 mL"/></Procedure></Blueprint>
<Synthesis><Hardware/><Reagents/><Procedure/></Synthesis></XDL>"""
USING = 'Moisten pot="reactor" wet="water"'
ADD = 'Add vessel="reactor" reagent="water" volume="60 mL"'


def asked(
    text: str,
    graph: dict[str, Any] | None = None,
    **wishes: Any,  # noqa: ANN401 - any field of `PreviewAsked`
) -> dict[str, Any]:
    raw = json.dumps(graph or bench()).encode()
    return open_recipe(replace(PreviewAsked(name="r", recipe=text.encode(), graph=raw), **wishes))


def told(answer: dict[str, Any]) -> list[tuple[str, str]]:
    return [(finding["about"], finding["code"]) for finding in answer["findings"]]


def test_a_parameter_is_asked_for_with_its_unit_and_limits() -> None:
    answer = asked(WITH_PARAMETERS)
    dose, warmth = answer["recipe"]["parameters"]
    assert dose == {
        "id": "dose", "sort": "volume", "unit": "mL", "value": "", "least": "1 mL", "most": "20 mL",
    }  # fmt: skip
    assert (warmth["unit"], warmth["value"]) == ("°C", "60 °C")
    assert told(answer) == [("wish", "xdl.no_parameter_value")]
    assert answer["findings"][0]["context"]["parameter"] == "dose"


@pytest.mark.parametrize(
    ("value", "code"),
    [
        ("0.5 mL", "xdl.parameter_limit"),
        ("21 mL", "xdl.parameter_limit"),
        ("two drops", "unit.vague"),
        ("5 g", "unit.unknown"),
        ("1,5 mL", "unit.comma"),
    ],
)
def test_a_value_that_is_none_or_outside_is_told_at_its_parameter(value: str, code: str) -> None:
    answer = asked(WITH_PARAMETERS, parameters={"dose": value})
    (finding,) = answer["findings"]
    assert finding["code"] == code
    assert (finding["about"], finding["context"]["parameter"]) == ("wish", "dose")
    assert answer["plan"] is None


def test_a_given_value_is_what_the_plan_moves() -> None:
    answer = asked(WITH_PARAMETERS, parameters={"dose": "12.5 mL", "warmth": "313.15 K"})
    assert (answer["findings"], answer["is_proved"]) == ([], True)
    claims = [step["does"] for step in answer["plan"]["steps"]]
    assert next(c for c in claims if c["kind"] == "transfer")["volume_ul"] == 12_500
    assert next(c for c in claims if c["kind"] == "heat")["temperature_c"] == 40


def test_a_blueprint_of_another_file_is_used() -> None:
    text = recipe(USING)
    assert ("recipe", "xdl.unknown_step") in told(asked(text))
    answer = asked(text, blueprints=(BLUEPRINT.encode(),))
    assert (answer["findings"], answer["is_proved"]) == ([], True)


def test_each_thing_that_a_vessel_cannot_hold_is_told_with_its_vessel() -> None:
    holds = {"reactor": {"water": "5 drops", "ether": "3 mL"}, "filter": {"water": "2"}}
    answer = asked(recipe(ADD), holds=holds)
    assert [f["context"] for f in answer["findings"]] == [
        {"vessel": "reactor", "reagent": "water"},
        {"vessel": "filter", "reagent": "water"},
    ]


def test_lines_are_rinsed_with_what_the_recipe_does_not_use_otherwise() -> None:
    text = recipe(ADD, 'Add vessel="filter" reagent="ether" volume="10 mL"')
    graph = bench()
    spare = next(node for node in graph["nodes"] if node["id"] == "flask_spare")
    spare["chemical"] = "acetone"
    answer = asked(text, graph, rinse=("acetone",))
    assert (answer["findings"], answer["is_proved"]) == ([], True)
    claims = [step["does"] for step in answer["plan"]["steps"]]
    assert {c["lot"] for c in claims if c["kind"] == "clean"} == {"acetone"}
    assert told(asked(text, rinse=("brine",))) == [("rig", "plan.no_reagent")]


def test_a_reagent_in_two_flasks_says_so_and_one_of_them_can_be_chosen() -> None:
    graph = bench()
    spare = next(node for node in graph["nodes"] if node["id"] == "flask_spare")
    spare["chemical"] = "water"
    answer = asked(recipe(ADD), graph)
    assert binding(answer, "water")["keys"] == ["flask_spare", "flask_water"]
    (note,) = [text for text in answer["plan"]["notes"] if text.startswith("water is in")]
    assert "flask_spare, flask_water" in note
    chosen = asked(recipe(ADD), graph, bind={"water": "flask_spare"})
    assert chosen["plan"]["bindings"]["reagents"]["water"] == "flask_spare"
    assert not [text for text in chosen["plan"]["notes"] if text.startswith("water is in")]


def test_a_flask_that_looks_like_the_reagent_is_named_and_never_taken() -> None:
    text = WATER.replace(b"Water", b"water").decode()
    answer = open_recipe(PreviewAsked(name="warm", recipe=text.encode(), graph=STARTER))
    finding = next(f for f in answer["findings"] if f["code"] == "plan.no_reagent")
    assert "water holds 'Water'" in finding["message"]
    assert finding["context"]["alike"] == ["water"]
    row = binding(answer, "water")
    assert (row["keys"], row["alike"]) == ([], ["water"])
    held = next(node for node in answer["rig"]["nodes"] if node["key"] == "water")["holds"]
    assert held[0]["name"] == "Water"
    assert held[0]["volume_ul"] > 0


@pytest.mark.parametrize(
    ("sort", "text", "again"),
    [
        ("volume", "0.5 L", "500 mL"),
        ("temperature", "20–25 °C", "20–25 °C"),
        ("temperature", "r.t.", "room temperature"),
        ("time", "overnight", "overnight"),
        ("amount", "2 equiv", "2 eq"),
        ("amount", "20 mg/eq", "0.02 g/eq"),
        ("flow", "60 mL/h", "1 mL/min"),
        ("count", "3", "3"),
        ("bool", "True", "true"),
        ("number", "1.50", "1.5"),
    ],
)
def test_a_value_is_written_as_a_recipe_writes_it(sort: str, text: str, again: str) -> None:
    wanted = Property(name="x", sort=sort)
    value = read_value(text, wanted)
    assert written(value) == again
    assert read_value(again, wanted) == value
    assert written(None) == ""
    assert written(Decimal(100)) == "100"
    assert unit_of("ph") == ""


def test_a_flask_that_holds_something_is_not_taken_for_an_empty_one() -> None:
    text = """<XDL><Synthesis><Hardware><Component id="reactor" type="reactor"/>
    <Component id="product" type="flask"/></Hardware><Reagents><Reagent name="Water"/></Reagents>
    <Procedure><Add vessel="reactor" reagent="Water" volume="2 mL"/>
    <Transfer from_vessel="reactor" to_vessel="product" volume="all"/></Procedure>
    </Synthesis></XDL>"""
    answer = open_recipe(PreviewAsked(name="r", recipe=text.encode(), graph=STARTER))
    (finding,) = answer["findings"]
    assert finding["code"] == "plan.vessel_ambiguous"
    assert "flask_1, flask_2:" in finding["message"]
    assert not {"acid", "dye", "water"} & {*finding["message"].replace(",", "").split()}


def test_no_plan_is_made_while_what_is_stated_cannot_be_read() -> None:
    asked = PreviewAsked(name="warm", recipe=WATER, graph=STARTER, bind={"reactor": "reactor_1"})
    assert open_recipe(asked)["is_proved"] is True
    answer = open_recipe(replace(asked, declared=b"{}x"))
    assert (answer["plan"], answer["is_proved"]) == (None, None)


def stating(raw: bytes) -> dict[str, Any]:
    graph = (LAB / "lab.json").read_bytes()
    recipe_raw = (LAB / "protocols/benzhydryl_acetate.xdl").read_bytes()
    return open_recipe(PreviewAsked(name="one", recipe=recipe_raw, graph=graph, declared=raw))


def test_what_is_stated_beside_the_recipe_binds() -> None:
    answer = stating(DECLARED.read_bytes())
    assert (answer["findings"], answer["is_proved"]) == ([], True)
    assert binding(answer, "brine")["keys"] == ["bottle_brine"]
    assert binding(answer, "brine")["is_stated"]
    assert not binding(answer, "reactor")["is_stated"]


@pytest.mark.parametrize(
    ("raw", "word"),
    [
        (b'{"keys": {"brine": 1}}', "$.keys"),
        (b'{"keys":\n {"brine"}}', "line 2, column 10"),
        (b'{"keys": {}, "keys": {}}', "keys"),
        (b'{"keys": {"brime": "bottle_brine"}}', "brime"),
        (b'{"receivers": {"rotovap": "rotavap_receiver"}}', "rotovap"),
        (b'{"schema": "labweb.declared/9"}', "labweb.declared/9"),
    ],
)
def test_a_statement_that_cannot_be_read_or_fits_nothing_is_told_apart(
    raw: bytes, word: str
) -> None:
    answer = stating(raw)
    found = [finding for finding in answer["findings"] if finding["about"] == "declared"]
    assert [finding["code"] for finding in found] == ["xdl.not_declared"]
    assert word in found[0]["message"]
    assert answer["plan"] is None
