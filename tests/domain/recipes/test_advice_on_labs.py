"""What to change in a lab of ours: the starter lab, whose two valves have a pump each.

    water, acid, dye ──▶ valve_1 ◀──▶ valve_2 ──▶ flask_1, flask_2, waste
                            └──▶ reactor_1 ◀──┘    on heater_1, which stirs too

The corrected lab is a lab file that can be imported, and on it the recipe is compiled and proved.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.rig.rig_model import RigFormat
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.recipes.recipe_preview import PreviewAsked, advise_on, open_recipe
from tests.domain.recipes.test_opening import RECIPE, STARTER

SEPARATOR = '<Component id="separator" type="separator"/>'
ADD = '<Add vessel="reactor" reagent="Water" volume="2 mL"/>'
CHILL = '<HeatChillToTemp vessel="reactor" temp="-60 °C"/>'
SEPARATE = (
    '<Separate from_vessel="reactor" separation_vessel="separator" to_vessel="separator" '
    'purpose="wash" product_phase="bottom" solvent="ether" solvent_volume="10 mL"/>'
)


def recipe(*steps: str, hardware: str = "") -> bytes:
    return f"""<XDL><Synthesis>
    <Hardware><Component id="reactor" type="reactor"/>{hardware}</Hardware>
    <Reagents><Reagent name="Water"/><Reagent name="ether"/></Reagents>
    <Procedure>{"".join(steps)}</Procedure></Synthesis></XDL>""".encode()


def lab(without: tuple[str, ...] = (), **ports: int) -> bytes:
    """Return the starter lab without some resources, and valves with so many ports."""
    value = json.loads(STARTER)
    gone = set(without)
    for entry in value["resources"]:
        if entry["key"] in ports:
            entry["config"]["ports_count"] = ports[entry["key"]]
        if entry["parent"] in gone:
            entry["parent"] = "bench_1"
    value["resources"] = [entry for entry in value["resources"] if entry["key"] not in gone]
    value["connections"] = [
        c
        for c in value["connections"]
        if not {c["source"]["resource"], c["target"]["resource"]} & gone
    ]
    value["devices"] = [d for d in value["devices"] if not {*d["nodes"].values()} & gone]
    return json.dumps(value).encode()


def advised(asked: PreviewAsked) -> dict[str, Any]:
    """Return the advice, once the corrected lab is one and the recipe is proved on it."""
    assert open_recipe(asked)["plan"] is None
    advice = advise_on(asked)
    assert advice["ok"], advice
    graph = advice["graph"].encode()
    read_lab(graph)
    assert read_rig(graph).format is RigFormat.LABWEB
    answer = open_recipe(replace(asked, graph=graph))
    assert (answer["findings"], answer["is_proved"]) == ([], True)
    return advice


def kinds(advice: dict[str, Any]) -> list[str]:
    return [change["change"] for change in advice["changes"]]


@pytest.mark.parametrize(
    ("text", "graph", "wanted"),
    [
        (recipe(ADD, ADD.replace("Water", "ether")), lab(), ["add_flask"]),
        (recipe(ADD.replace("2 mL", "200 mL")), lab(), ["enlarge"]),
        (recipe(ADD, CHILL), lab(), ["attach"]),
        (recipe(ADD, '<Stir vessel="reactor" time="1 min"/>'), lab(("heater_1",)), ["attach"]),
        (recipe(ADD), lab(("reactor_1",)), ["add_vessel"]),
        (recipe(ADD, SEPARATE, hardware=SEPARATOR), lab(), ["add_flask", "add_vessel", "attach"]),
    ],
)
def test_what_is_missing_in_a_lab_is_drawn_into_it(
    text: bytes, graph: bytes, wanted: list[str]
) -> None:
    advice = advised(PreviewAsked(name="r", recipe=text, graph=graph))
    assert sorted(kinds(advice)) == wanted


ROTAVAP = '<Component id="rotavap" type="rotavap"/>'
FLASK = '<Component id="flask" type="flask"/>'
OVER = '<Transfer from_vessel="reactor" to_vessel="rotavap" volume="2 mL"/>'
BOIL = '<Evaporate vessel="rotavap" time="5 min" temp="40 °C" pressure="100 mbar"/>'
PURGE = '<Purge vessel="reactor" time="1 min"/>'
REFILL = '<EvacuateAndRefill vessel="reactor" gas="argon" repeats="3"/>'
THROUGH = '<FilterThrough from_vessel="reactor" to_vessel="flask" through="silica"/>'


def test_a_rotary_evaporator_is_drawn_whole_with_its_receiver_and_vacuum() -> None:
    text = recipe(ADD, OVER, BOIL, hardware=ROTAVAP)
    advice = advised(PreviewAsked(name="r", recipe=text, graph=lab()))
    assert kinds(advice) == ["add_vessel", "join_vacuum"]
    first = advice["changes"][0]
    assert first["adds"] == ["rotavap", "rotavap_receiver", "evaporator_rotavap"]
    assert "rotavap_receiver of 250 mL at port 6 of valve_1" in first["text"]
    after = {entry["key"]: entry for entry in json.loads(advice["graph"])["resources"]}
    assert after["rotavap"]["parent"] == "evaporator_rotavap"


def test_a_flask_on_an_evaporator_without_a_receiver_gets_one_that_is_drained() -> None:
    whole = json.loads(
        advised(
            PreviewAsked(name="r", recipe=recipe(ADD, OVER, BOIL, hardware=ROTAVAP), graph=lab())
        )["graph"]
    )
    gone = "rotavap_receiver"
    whole["resources"] = [entry for entry in whole["resources"] if entry["key"] != gone]
    whole["connections"] = [
        c for c in whole["connections"] if gone not in {c[end]["resource"] for end in ENDS}
    ]
    asked = PreviewAsked(
        name="r",
        recipe=recipe(ADD, OVER, BOIL, hardware=ROTAVAP),
        graph=json.dumps(whole).encode(),
    )
    advice = advised(asked)
    assert kinds(advice) == ["add_receiver"]
    assert "behind the condenser of rotavap, with a tube to port" in advice["changes"][0]["text"]


ENDS = ("source", "target")


@pytest.mark.parametrize(
    ("steps", "wanted"),
    [
        ((ADD, PURGE), ["add_valve", "join_gas"]),
        ((REFILL, ADD), ["add_valve", "join_gas", "join_vacuum"]),
        ((REFILL, ADD, PURGE), ["add_valve", "join_gas", "join_vacuum"]),
    ],
)
def test_gas_and_vacuum_come_by_a_valve_of_their_own(
    steps: tuple[str, ...], wanted: list[str]
) -> None:
    advice = advised(PreviewAsked(name="r", recipe=recipe(*steps), graph=lab()))
    assert kinds(advice) == wanted
    after = json.loads(advice["graph"])
    new = [c for c in after["connections"] if "valve_gas" in str(c)]
    assert {c["medium"] for c in new} == {"gas"}
    (bottle,) = [e for e in after["resources"] if e["config"].get("gas")]
    assert "contents" not in bottle


def test_a_cartridge_is_drawn_between_two_valves() -> None:
    text = recipe(ADD, THROUGH, hardware=FLASK).replace(
        b"<Reagents>", b'<Reagents><Reagent name="silica"/>'
    )
    bind = {"flask": "flask_1"}
    advice = advised(PreviewAsked(name="r", recipe=text, graph=lab(), bind=bind))
    assert kinds(advice) == ["add_valve", "add_cartridge"]
    after = json.loads(advice["graph"])["resources"]
    assert [e["config"] for e in after if e["kind"] == "cartridge"] == [{"filling": "silica"}]


def test_a_published_recipe_gets_flasks_and_a_separator_and_each_says_its_port() -> None:
    bind = {"water": "water", "product": "flask_1"}
    advice = advised(PreviewAsked(name="a", recipe=RECIPE, graph=STARTER, bind=bind))
    assert sorted({*kinds(advice)}) == ["add_flask", "add_valve", "add_vessel", "attach"]
    texts = [change["text"] for change in advice["changes"]]
    assert any("of 100 mL, full, for triethylamine at port" in text for text in texts)
    assert not any("shaft" in text for text in texts)
    for change in advice["changes"]:
        assert change["adds"] or change["change"] == "enlarge"


def test_drivers_contents_and_ports_of_the_lab_stay_as_they_are() -> None:
    text = recipe(ADD, ADD.replace("Water", "ether"))
    before = json.loads(STARTER)
    after = json.loads(advised(PreviewAsked(name="r", recipe=text, graph=STARTER))["graph"])
    assert after["devices"] == before["devices"]
    assert [e for e in after["resources"] if e in before["resources"]] == before["resources"]
    assert [c for c in after["connections"] if c in before["connections"]] == before["connections"]
    (added,) = [e for e in after["resources"] if e not in before["resources"]]
    (lot,) = added["contents"]
    (material,) = [m for m in after["materials"] if m not in before["materials"]]
    assert (added["kind"], material["name"]) == ("bottle", "ether")
    assert {lot["lot"]: material["key"]} == {
        n["key"]: n["material"] for n in after["lots"] if n not in before["lots"]
    }


def test_no_port_that_a_valve_does_not_have_is_used() -> None:
    text = recipe(ADD, ADD.replace("Water", "ether"))
    graph = lab(("waste", "flask_1", "flask_2"), valve_1=4, valve_2=3)
    after = json.loads(advised(PreviewAsked(name="r", recipe=text, graph=graph))["graph"])
    most = {e["key"]: e["config"].get("ports_count") for e in after["resources"]}
    for connection in after["connections"]:
        for end in (connection["source"], connection["target"]):
            if end["resource"].startswith("valve") and end["port"] != "common":
                assert int(end["port"]) <= most[end["resource"]], end


def test_a_reagent_that_is_there_under_another_case_is_left_to_a_person() -> None:
    text = recipe(ADD).replace(b"Water", b"water")
    advice = advise_on(PreviewAsked(name="r", recipe=text, graph=STARTER))
    assert not advice["ok"]
    assert "water holds 'Water'" in advice["findings"][0]["message"]


@pytest.mark.parametrize(
    ("steps", "hardware"),
    [
        ('<Irradiate vessel="reactor" time="1 min" wavelength="450 nm"/>', ""),
        ('<Filter vessel="filter"/>', '<Component id="filter" type="filter"/>'),
    ],
)
def test_what_a_lab_file_has_no_word_for_is_not_drawn(steps: str, hardware: str) -> None:
    text = recipe(ADD, steps, hardware=hardware)
    advice = advise_on(PreviewAsked(name="r", recipe=text, graph=STARTER))
    assert not advice["ok"]
    assert {finding["code"] for finding in advice["findings"]} == {"plan.no_advice"}


@pytest.mark.parametrize(("degrees", "is_asked"), [("-60", False), ("160", False), ("40", True)])
def test_a_heater_whose_lowest_temperature_nobody_says_is_not_asked_to_chill(
    degrees: str, *, is_asked: bool
) -> None:
    text = recipe(ADD, CHILL.replace("-60", degrees))
    answer = open_recipe(PreviewAsked(name="r", recipe=text, graph=STARTER))
    assert (answer["plan"] is not None) is is_asked
    if not is_asked:
        (finding,) = answer["findings"]
        assert finding["code"] == "plan.out_of_range"
        assert "heater_1 from ? to 150 °C, which only heats" in finding["message"]
