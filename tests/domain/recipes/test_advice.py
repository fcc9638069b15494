"""What to change where a recipe does not fit the rig of `plans.bench`, of which parts are missing.

Each corrected graph is read, compiled and proved anew.
"""

from __future__ import annotations

import json
from copy import deepcopy
from itertools import combinations
from typing import Any

import pytest

from labweb.domain.errors import Finding
from labweb.domain.graph.rig.rig_model import RigFormat
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.graph.rig.rig_write import write_rig
from labweb.domain.recipes.advise import fewest_changes
from labweb.domain.recipes.advise.fewest_changes import Advice, advise
from labweb.domain.recipes.on_rig.equipment import Equipment
from labweb.domain.recipes.xdl.file_format.read_xdl import check_document
from labweb.domain.recipes.xdl.file_format.xml_tree import parse_markup
from tests.domain.recipes.plans import bench, compiled, reasons, recipe

ADD = 'Add vessel="reactor" reagent="water" volume="60 mL"'
ADD_ETHER = 'Add vessel="filter" reagent="ether" volume="10 mL"'
STIR = 'Stir vessel="reactor" time="1 min"'
HEAT = 'HeatChill vessel="reactor" temp="60 °C" time="1 min"'
CHILL = 'HeatChillToTemp vessel="reactor" temp="-20 °C"'
FREEZE = 'HeatChillToTemp vessel="reactor" temp="-78 °C"'
SEPARATE = (
    'Separate from_vessel="reactor" separation_vessel="separator" to_vessel="filter" '
    'purpose="wash" product_phase="bottom" solvent="ether" solvent_volume="20 mL" repeats="2"'
)
EVAPORATE = 'Evaporate vessel="rotavap" time="10 min"'
ROTAVAP = (
    '<Component id="reactor" type="reactor"/><Component id="rotavap" type="rotavap"/>'
    '<Component id="filter" type="filter"/><Component id="separator" type="separator"/>'
)
TO_ROTAVAP = 'Transfer from_vessel="reactor" to_vessel="rotavap" volume="all"'
PURGE = 'Purge vessel="reactor"'
DRY = 'Dry vessel="reactor" time="1 h"'
LAMP = 'Irradiate vessel="reactor" time="1 min" wavelength="450 nm"'
COLUMN = 'FilterThrough from_vessel="reactor" to_vessel="filter" through="celite"'
WITH_CELITE = ("water", "ether", "celite")


def without(graph: dict[str, Any], *keys: str) -> dict[str, Any]:
    gone = set(keys)
    return {
        "nodes": [n for n in graph["nodes"] if n["id"] not in gone],
        "links": [n for n in graph["links"] if not {n["source"], n["target"]} & gone],
    }


def asked(text: str, graph: dict[str, Any]) -> Advice | list[Finding]:
    rig = read_rig(json.dumps(graph).encode())
    vessels = frozenset(Equipment(rig).vessels)
    read, findings = check_document(parse_markup(text.encode()), rig_vessels=vessels)
    assert not findings
    return advise(read, rig)


def advised(text: str, graph: dict[str, Any]) -> list[str]:
    """Return the kinds of the changes, once the corrected graph compiles and is proved."""
    before = deepcopy(graph)
    assert reasons(text, graph)
    found = asked(text, graph)
    assert isinstance(found, Advice), found
    assert graph == before
    compiled(text, json.loads(found.graph))
    return [change["change"] for change in found.changes]


@pytest.mark.parametrize(
    ("steps", "gone", "kinds"),
    [
        ((ADD,), ("flask_water",), ["add_flask"]),
        ((ADD, STIR), ("stirrer_r", "heater"), ["attach"]),
        ((ADD, HEAT), ("heater",), ["attach"]),
        ((ADD, CHILL), (), ["attach"]),
        ((ADD, FREEZE), (), ["attach"]),
        ((ADD, LAMP), (), ["attach"]),
        ((ADD,), ("reactor", "stirrer_r", "heater"), ["add_vessel"]),
        ((ADD, PURGE), (), ["add_valve", "join_gas"]),
        ((ADD, DRY), (), ["add_valve", "join_vacuum"]),
        ((ADD, SEPARATE), ("waste_1", "waste_2"), ["add_vessel"]),
        ((ADD, COLUMN), (), ["add_valve", "add_cartridge"]),
        ((ADD, ADD_ETHER), ("flask_water", "flask_ether"), ["add_flask", "add_flask"]),
    ],
)
def test_one_missing_part_is_one_change(
    steps: tuple[str, ...], gone: tuple[str, ...], kinds: list[str]
) -> None:
    text = recipe(*steps, reagents=WITH_CELITE)
    assert advised(text, without(bench(), *gone)) == kinds


def test_a_separator_comes_with_its_stirrer_and_says_where_it_is_joined() -> None:
    text = recipe(ADD, SEPARATE)
    graph = without(bench(), "separator", "stirrer_s", "sensor")
    assert advised(text, graph) == ["add_vessel", "attach"]
    found = asked(text, graph)
    assert isinstance(found, Advice)
    assert found.changes[0]["text"].startswith("Add separator separator of 100 mL at port ")
    assert found.changes[0]["adds"] == ["separator"]


def test_a_rotary_evaporator_comes_with_its_vacuum() -> None:
    text = recipe(ADD, TO_ROTAVAP, EVAPORATE, hardware=ROTAVAP)
    assert advised(text, bench()) == ["add_valve", "add_vessel", "join_vacuum"]


def test_a_vessel_that_is_too_small_is_exchanged_for_the_next_common_size() -> None:
    text = recipe(ADD, ADD, 'Add vessel="reactor" reagent="ether" volume="200 mL"')
    graph = bench(reactor=100)
    assert advised(text, graph) == ["enlarge"]
    found = asked(text, graph)
    assert isinstance(found, Advice)
    assert found.changes[0]["text"] == "Exchange reactor, which holds 100 mL, for one of 500 mL"


def test_a_larger_vessel_is_not_advised_where_what_is_stated_is_wrong() -> None:
    graph = bench(reactor=100)
    next(node for node in graph["nodes"] if node["id"] == "reactor")["current_volume"] = 150
    found = asked(recipe(ADD), graph)
    assert isinstance(found, list)
    (finding,) = found
    assert (finding.code, finding.subject) == ("plan.no_advice", "reactor")
    assert "correct what is stated" in finding.message


def crowded(chemical: str) -> dict[str, Any]:
    """Draw the rig with no port of a valve left, for flasks of one substance stand there."""
    graph = without(bench(), "flask_water")
    for number, (valve, port) in enumerate([(1, 0), (1, 4)]):
        key = f"flask_idle_{number}"
        graph["nodes"].append({"id": key, "class": "ChemputerFlask", "chemical": chemical})
        ends = {"source": key, "target": f"valve_{valve}", "port": f"(0,{port})"}
        graph["links"].append({"id": key, **ends})
    return graph


def test_without_a_free_port_a_reagent_takes_the_place_of_one_that_is_not_used() -> None:
    graph = crowded("toluene")
    assert advised(recipe(ADD), graph) == ["swap_flask"]
    found = asked(recipe(ADD), graph)
    assert isinstance(found, Advice)
    assert "in the place of" in found.changes[0]["text"]


def test_without_a_free_port_and_an_idle_flask_a_valve_is_added() -> None:
    text = recipe(ADD, ADD_ETHER)
    assert advised(text, crowded("ether")) == ["add_valve", "add_flask"]


def test_a_pump_that_draws_on_a_vessel_that_holds_something_is_taken_off_it() -> None:
    graph = bench()
    graph["nodes"].append({"id": "rotavap", "class": "IKARV10"})
    for one, two, port in (
        ("rotavap", "valve_1", "(evaporate,4)"),
        ("valve_1", "rotavap", "(4,evaporate)"),
        ("pump_vacuum", "rotavap", "(,)"),
    ):
        graph["links"].append({"id": f"{one}{two}", "source": one, "target": two, "port": port})
    to_filter = 'Transfer from_vessel="reactor" to_vessel="filter" volume="10 mL"'
    text = recipe(ADD, to_filter, TO_ROTAVAP, 'Filter vessel="filter"', hardware=ROTAVAP)
    assert "plan.vacuum_shared" in reasons(text, graph)
    assert advised(text, graph) == ["own_vacuum"]


PARTS = ("flask_water", "flask_ether", "stirrer_r", "heater", "separator", "waste_1", "pump_vacuum")


@pytest.mark.parametrize("gone", list(combinations(PARTS, 3)))
def test_whatever_three_parts_are_missing_the_corrected_graph_is_proved(
    gone: tuple[str, ...],
) -> None:
    text = recipe(ADD, HEAT, SEPARATE, 'Dry vessel="filter" time="1 h"')
    found = asked(text, without(bench(), *gone))
    assert isinstance(found, Advice), found
    compiled(text, json.loads(found.graph))
    for change in found.changes:
        assert change["text"]


def test_no_change_that_is_advised_can_be_left_out() -> None:
    text, graph = recipe(ADD, HEAT, SEPARATE), without(bench(), "flask_water", "heater")
    found = asked(text, graph)
    assert isinstance(found, Advice)
    for change in found.changes:
        fewer = without(json.loads(found.graph), *change["adds"])
        assert reasons(text, fewer), change


def test_a_graph_drawn_with_yed_gets_advice_as_json() -> None:
    rig = read_rig(json.dumps(without(bench(), "flask_water")).encode())
    drawn = read_rig(write_rig(rig, RigFormat.GRAPHML))
    read, _ = check_document(parse_markup(recipe(ADD).encode()))
    found = advise(read, drawn)
    assert isinstance(found, Advice)
    compiled(recipe(ADD), json.loads(found.graph))


def test_a_cartridge_that_leads_elsewhere_is_joined_anew() -> None:
    graph = without(bench(), "flask_spare")
    for key, class_ in (("column", "ChemputerCartridge"), ("flask_end", "ChemputerFlask")):
        graph["nodes"].append({"id": key, "class": class_, "max_volume": 100})
    graph["nodes"][-2]["chemical"] = "celite"
    for source, target, port in (
        ("valve_1", "column", "(4,in)"),
        ("column", "flask_end", "(out,0)"),
    ):
        link = {"id": f"{source}-{target}", "source": source, "target": target, "port": port}
        graph["links"].append(link)
    assert reasons(recipe(ADD, COLUMN, reagents=WITH_CELITE), graph) == ["plan.no_route"]
    assert advised(recipe(ADD, COLUMN, reagents=WITH_CELITE), graph) == ["move_cartridge"]


class Late:
    """A clock on which each look at it is six seconds after the last."""

    def __init__(self) -> None:
        self.looks_count = 0

    def now_s(self) -> float:
        return self.monotonic_s()

    def monotonic_s(self) -> float:
        self.looks_count += 1
        return 6.0 * self.looks_count

    def wait(self, duration_s: float) -> None:
        raise AssertionError(duration_s)


def test_nobody_waits_for_advice_longer_than_ten_seconds() -> None:
    rig = read_rig(json.dumps(without(bench(), "flask_water", "heater")).encode())
    read, _ = check_document(parse_markup(recipe(ADD, HEAT).encode()))
    assert isinstance(advise(read, rig), Advice)
    found = advise(read, rig, None, Late())
    assert isinstance(found, list)
    assert [one.code for one in found] == ["plan.no_advice"]
    assert found[0].message.endswith("the recipe fits none: there was no time for others")


@pytest.mark.parametrize(
    ("steps", "code"),
    [
        (('Transfer from_vessel="reactor" to_vessel="filter" volume="all"',), "nothing_there"),
        (('Add vessel="reactor" reagent="water" volume="60 L"',), "plan.overflow"),
    ],
)
def test_what_no_plumbing_cures_gets_no_advice(steps: tuple[str, ...], code: str) -> None:
    found = asked(recipe(*steps), bench())
    assert isinstance(found, list)
    assert {one.code for one in found} == {"plan.no_advice"}
    assert any(code in one.message for one in found)


def test_a_graph_of_others_gets_no_advice() -> None:
    graph = {"nodes": [{"id": "reactor", "type": "container"}], "links": []}
    found = asked(recipe(ADD), graph)
    assert isinstance(found, list)
    assert [one.code for one in found] == ["plan.no_advice"]


def test_advice_whose_plan_is_not_proved_is_not_given(monkeypatch: pytest.MonkeyPatch) -> None:
    doubt = [Finding("interpret.claim", "the verifier does not believe it")]
    monkeypatch.setattr(fewest_changes, "find_unproved", lambda *_: doubt)
    found = asked(recipe(ADD), without(bench(), "flask_water"))
    assert isinstance(found, list)
    assert "interpret.claim" in found[0].message
