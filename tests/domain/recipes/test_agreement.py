"""A workflow of a recipe does what its plan is proved to do, and anything else is told."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from labweb.domain.errors import LabError
from labweb.domain.recipes.agreement.check import check_agreement, check_same
from labweb.domain.recipes.agreement.contents import check_contents, render_proved
from labweb.domain.recipes.agreement.keeping import changes_since
from labweb.domain.recipes.agreement.weaving import weave_rinses
from labweb.domain.recipes.recipe_preview import PreviewAsked, open_recipe, workflow_from
from tests.domain.recipes.plans import recipe
from tests.domain.recipes.test_opening import STARTER
from tests.domain.recipes.test_station_of_our_own import whole
from tests.domain.workflows.station import DECLARED, LAB, recipe_document, station, station_file

SYNTHESIS = (LAB / "protocols/benzhydryl_acetate.xdl").read_bytes()
GRAPH = (LAB / "lab.json").read_bytes()
DECLARED_RAW = DECLARED.read_bytes()
KEYS = {"water": "water", "acid": "acid", "reactor": "reactor_1"}


def document() -> dict[str, Any]:
    woven = weave_rinses(whole(), recipe_document())
    copy: dict[str, Any] = json.loads(json.dumps(woven))
    return copy


def first(found: dict[str, Any], kind: str, **wanted: str) -> dict[str, Any]:
    steps = (step for step in found["steps"] if step["kind"] == kind)
    params = (step["params"] for step in steps)
    return next(one for one in params if wanted.items() <= one.items())


def drop(found: dict[str, Any], kind: str) -> None:
    found["steps"].remove(next(step for step in found["steps"] if step["kind"] == kind))


def swap(found: dict[str, Any]) -> None:
    adds = [n for n, step in enumerate(found["steps"]) if step["kind"] == "transfer"][:2]
    one, other = (found["steps"][place] for place in adds)
    one["params"], other["params"] = other["params"], one["params"]


def test_the_workflow_of_the_synthesis_does_what_its_plan_is_proved_to_do() -> None:
    assert check_agreement(whole(), document()) == []


@pytest.mark.parametrize(
    "change",
    [
        lambda d: first(d, "transfer").update(volume="41 mL"),
        lambda d: first(d, "transfer").update(target="@separator"),
        lambda d: first(d, "transfer").update(source="@bottle_dcm"),
        lambda d: first(d, "transfer", volume="30 mL").update(flow_rate="17 uL/s"),
        lambda d: first(d, "transfer", through="@cartridge_mgso4").pop("through"),
        lambda d: first(d, "separate").update(target="@crude"),
        lambda d: first(d, "separate").update(settle_for="1 min"),
        lambda d: first(d, "heat_chill").update(temperature="5 °C"),
        lambda d: first(d, "heat_chill", hold_for="3600 s").update(hold_for="1 s"),
        lambda d: first(d, "heat_chill", hold_for="3600 s").update(stir_speed="250 rpm"),
        lambda d: first(d, "start_stir").update(stir_speed="600 rpm"),
        lambda d: first(d, "stir").update(duration="4 min"),
        lambda d: first(d, "evaporate").update(pressure="60 mbar"),
        lambda d: first(d, "evaporate").update(temperature="60 °C"),
        lambda d: first(d, "evacuate_refill").update(rounds="2"),
        lambda d: first(d, "evacuate_refill").pop("vacuum_for"),
        lambda d: drop(d, "stop_stir"),
        lambda d: drop(d, "transfer"),
        swap,
        lambda d: d["steps"].append({"id": "x", "kind": "weigh", "params": {"balance": "@b"}}),
    ],
)
def test_whatever_else_it_does_is_a_finding(change: Callable[[dict[str, Any]], object]) -> None:
    other = document()
    change(other)
    found = check_agreement(whole(), other)
    assert {finding.code for finding in found} == {"recipe.differs"}
    with pytest.raises(LabError) as refusal:
        check_same(whole(), other)
    assert list(refusal.value.findings) == found


@pytest.mark.parametrize("is_reversed", [True, False])
def test_edges_that_do_not_order_the_steps_as_they_are_listed_are_findings(
    is_reversed: bool,
) -> None:
    other = document()
    ends = {"source": "target", "target": "source"}
    turned = [edge | {end: edge[far] for end, far in ends.items()} for edge in other["edges"]]
    other["edges"] = turned if is_reversed else []
    found = check_agreement(whole(), other)
    assert {finding.code for finding in found} == {"recipe.differs"}
    assert ("s3", "s2") in {(one.subject, one.context["before"]) for one in found}


def test_one_edge_that_is_missing_is_a_finding() -> None:
    other = document()
    other["edges"] = [edge for edge in other["edges"] if edge["source"] != "s2"]
    found = check_agreement(whole(), other)
    told = {(one.subject, one.context["before"]): one.message for one in found}
    said = told["s3", "s2"]
    assert said.startswith("'Transfer 40 mL from bottle_thf to reactor")
    assert said.endswith(", and no edges say so")
    assert " has to follow '" in said


def test_a_difference_says_the_line_of_the_recipe_and_the_step_of_the_workflow() -> None:
    other = document()
    first(other, "transfer").update(volume="41 mL")
    (found,) = check_agreement(whole(), other)
    line = SYNTHESIS.decode().splitlines()[found.context["line"] - 1]
    assert 'reagent="tetrahydrofuran" volume="40 mL"' in line
    assert found.context["step"] == "s3"
    assert "move 40.00 mL" in found.message
    assert "move 41.00 mL" in found.message


REACTOR = '<Component id="reactor" type="reactor"/>'


def workflow(*steps: str, reagent: str = "") -> dict[str, Any]:
    text = recipe(*steps, hardware=REACTOR, reagents=("water", "acid"))
    raw = text.replace('<Reagent id="water"/>', f'<Reagent id="water" {reagent}/>').encode()
    asked = PreviewAsked(name="one", recipe=raw, graph=STARTER, bind=KEYS)
    found: dict[str, Any] = workflow_from(asked)["document"]
    return found


def kinds(found: dict[str, Any]) -> list[str]:
    return [step["kind"] for step in found["steps"]]


ADD = 'Add vessel="reactor" reagent="water" volume="2 mL"'
HEAT = 'vessel="reactor" temp="40 °C"'


@pytest.mark.parametrize(
    ("steps", "wanted"),
    [
        ((ADD,), ["transfer"]),
        ((f'{ADD} stir="true"', ADD), ["start_stir", "transfer", "stop_stir", "transfer"]),
        (
            (f'{ADD} stir="true"', f'{ADD} stir="true" stir_speed="400 RPM"'),
            ["start_stir", "transfer", "start_stir", "transfer", "stop_stir"],
        ),
        (
            (ADD, f'HeatChill {HEAT} time="10 min"', ADD),
            ["transfer", "start_stir", "heat_chill", "stop_stir", "transfer"],
        ),
        (
            (ADD, f"HeatChillToTemp {HEAT}", 'Wait time="5 min"'),
            ["transfer", "start_stir", "heat_chill", "wait", "stop_heat_stir"],
        ),
        (
            (ADD, f"HeatChillToTemp {HEAT}", ADD),
            ["transfer", "start_stir", "heat_chill", "stop_stir", "transfer", "stop_heat_stir"],
        ),
        (
            (ADD, f'HeatChill {HEAT} time="10 min" stir="false"'),
            ["transfer", "heat_chill"],
        ),
        (
            (
                ADD,
                'Stir vessel="reactor" time="5 min"',
                'Transfer from_vessel="reactor" to_vessel="water" volume="1 mL"',
            ),
            ["transfer", "stir", "transfer"],
        ),
    ],
)
def test_stirring_and_heating_go_on_and_end_as_in_the_plan(
    steps: tuple[str, ...], wanted: list[str]
) -> None:
    assert kinds(workflow(*steps)) == wanted


ACID = 'Add vessel="reactor" reagent="acid" volume="2 mL"'
CLEANS = 'use_for_cleaning="true"'


def ends(found: dict[str, Any]) -> list[tuple[str, str]]:
    return [(edge["source"], edge["target"]) for edge in found["edges"]]


def test_what_a_plan_rinses_comes_into_the_workflow_before_the_same_deed() -> None:
    found = workflow(ADD, ACID, reagent=CLEANS)
    assert [step["id"] for step in found["steps"]] == ["s1", "rinse1", "s2"]
    assert found["steps"][1]["params"] == {
        "source": "@water",
        "target": "@waste",
        "volume": "3 mL",
        "pump": "@pump_1",
    }
    assert {step["params"]["pump"] for step in found["steps"]} == {"@pump_1"}
    assert ends(found) == [("s1", "rinse1"), ("rinse1", "s2")]


def test_a_rinse_behind_a_wait_comes_before_it_for_nothing_waits_in_the_flask() -> None:
    found = workflow(ADD, 'Wait time="5 min"', ACID, reagent=CLEANS)
    assert [step["id"] for step in found["steps"]] == ["s1", "rinse1", "s2", "s3"]
    assert ends(found) == [("s1", "rinse1"), ("s2", "s3"), ("rinse1", "s2")]


def test_a_recipe_that_rinses_at_its_end_is_a_workflow_on_a_rig() -> None:
    found = workflow(ADD, 'ResetHandling solvent="water" volume="1.5 mL" repeats="2"')
    assert [step["id"] for step in found["steps"]] == ["s1", "rinse1", "rinse2"]
    assert found["steps"][2]["params"]["volume"] == "1.5 mL"
    assert ends(found) == [("s1", "rinse1"), ("rinse1", "rinse2")]


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["steps"].pop(1),
        lambda d: d["steps"][1]["params"].update(volume="2 mL"),
        lambda d: d["steps"][1]["params"].update(target="@reactor_1"),
        lambda d: d["steps"][1]["params"].update(pump="@pump_2"),
        lambda d: d["steps"][2]["params"].update(pump="@pump_2"),
        lambda d: d["steps"][2]["params"].pop("pump"),
    ],
)
def test_a_rinse_that_is_another_or_of_another_syringe_is_told(
    change: Callable[[dict[str, Any]], object],
) -> None:
    text = recipe(ADD, ACID, hardware=REACTOR, reagents=("water", "acid"))
    raw = text.replace('<Reagent id="water"/>', f'<Reagent id="water" {CLEANS}/>').encode()
    asked = PreviewAsked(name="one", recipe=raw, graph=STARTER, bind=KEYS)
    plan, found = open_recipe(asked)["plan"], workflow_from(asked)["document"]
    assert check_agreement(plan, found, ["pump_1", "pump_2"]) == []
    change(found)
    told = check_agreement(plan, found, ["pump_1", "pump_2"])
    assert {finding.code for finding in told} == {"recipe.differs"}


def test_the_only_syringe_of_a_rig_need_not_be_named() -> None:
    text = recipe(ADD, ACID, hardware=REACTOR, reagents=("water", "acid"))
    raw = text.replace('<Reagent id="water"/>', f'<Reagent id="water" {CLEANS}/>').encode()
    asked = PreviewAsked(name="one", recipe=raw, graph=STARTER, bind=KEYS)
    plan, found = open_recipe(asked)["plan"], workflow_from(asked)["document"]
    for step in found["steps"]:
        step["params"].pop("pump")
    assert check_agreement(plan, found, ["pump_1"]) == []
    assert check_agreement(plan, found)


MOVED: list[Callable[[dict[str, Any]], object]] = [
    lambda d: d["steps"][0].update(position={"x": 7.0, "y": 9.0}),
    lambda d: d["steps"][0].update(note="by the window"),
    lambda d: d["steps"].reverse(),
    lambda d: d.update(name="Another name"),
    lambda d: d.update(execution={"on_disconnect": "continue", "max_offline_s": 60}),
    lambda d: [edge.update(id=f"x{edge['id']}") for edge in d["edges"]],
    lambda d: first(d, "transfer", volume="40 mL").update(volume="40000 uL"),
]


@pytest.mark.parametrize("change", MOVED)
def test_layout_names_and_other_spellings_leave_the_proof(
    change: Callable[[dict[str, Any]], object],
) -> None:
    other = document()
    change(other)
    assert changes_since(document(), other, {}) == []


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            lambda d: first(d, "transfer", volume="40 mL").update(volume="41 mL"),
            "'Transfer 40 mL from bottle_thf to reactor with pump_1' was 40 mL and is 41 mL",
        ),
        (
            lambda d: first(d, "react").update(duration="1 s"),
            "duration of '",
        ),
        (lambda d: d["steps"].pop(0), "' was taken out"),
        (lambda d: d["steps"].append({"id": "new", "kind": "wait"}), "'Wait …' was put in"),
        (lambda d: d["steps"][0].update(kind="wait"), "became 'Wait …'"),
        (lambda d: d["steps"][0].update(kind=[]), "became a step []"),
        (lambda d: d["steps"][2].update(params=None), "and is left open"),
        (lambda d: d["edges"].pop(0), "was taken out"),
        (lambda d: d["edges"].append(dict(d["edges"][0])), "was put in"),
        (lambda d: d.update(steps="none", edges=7), "was taken out"),
    ],
)
def test_what_takes_the_proof_away_is_told_by_step(
    change: Callable[[dict[str, Any]], object], text: str
) -> None:
    other = document()
    change(other)
    found = changes_since(document(), other, {})
    assert {one.code for one in found} == {"recipe.proof_lost"}
    assert any(text in one.message for one in found), [one.message for one in found]


def proved() -> dict[str, Any]:
    told = workflow_from(
        PreviewAsked(name="one", recipe=SYNTHESIS, graph=GRAPH, declared=DECLARED_RAW)
    )
    return render_proved(told["proved"], station_file())


def test_what_is_kept_of_a_proof_names_the_material_of_each_flask() -> None:
    sources = proved()["sources"]
    keys = {str(one.id): one.key for one in station_file().resources}
    told = {keys[one]: entry for one, entry in sources.items()}
    assert told["bottle_ether"] == {"reagent": "diethyl ether", "materials": ["diethyl_ether"]}
    assert check_contents(proved(), station()) == []


def test_a_flask_that_holds_something_else_by_then_keeps_a_run_from_starting() -> None:
    (found,) = check_contents(proved(), station(bottle_ether={"dcm": 1000.0}))
    assert found.code == "recipe.other_content"
    assert "diethyl ether" in found.message
    mixed = station(bottle_ether={"ether": 50_000.0, "dcm": 1.0})
    assert [one.code for one in check_contents(proved(), mixed)] == ["recipe.other_content"]
    assert check_contents(proved(), station(bottle_ether={})) == []


def test_a_flask_that_was_empty_may_not_give_what_nobody_compared() -> None:
    told = proved()
    for entry in told["sources"].values():
        entry["materials"] = []
    assert len(check_contents(told, station())) == len(told["sources"])


@pytest.mark.parametrize("key", ["reactor", "separator", "rotavap_flask", "crude"])
def test_a_vessel_that_was_empty_and_has_something_left_in_it_keeps_a_run_from_starting(
    key: str,
) -> None:
    (found,) = check_contents(proved(), station(**{key: {"dcm": 1.0}}))
    assert found.code == "recipe.other_content"
    assert "held nothing when that was proved; it holds dichloromethane" in found.message
    assert check_contents(proved(), station(**{key: {"dcm": 1.0}}), among=set()) == []


def test_a_vessel_that_held_something_and_is_empty_keeps_a_run_from_starting() -> None:
    told = proved()
    for entry in told["vessels"].values():
        entry["materials"] = ["dichloromethane"]
    assert len(check_contents(told, station())) == len(told["vessels"])


def test_a_proof_that_kept_its_sources_only_is_checked_by_these() -> None:
    told = proved()
    del told["vessels"]
    assert check_contents(told, station(reactor={"dcm": 1.0})) == []
    assert len(check_contents(told, station(bottle_ether={"dcm": 1.0}))) == 1
