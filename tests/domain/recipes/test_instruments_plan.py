"""Ultrasound, microwaves, centrifuges, condensers, a pH that is adjusted, and loops of readings.

The rig is that of `plans.bench`; each test joins to it what it needs. Every plan is proved.
"""

from __future__ import annotations

import json
from copy import deepcopy
from typing import Any

import pytest

from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.proof.execute_plan import execute
from labweb.domain.proof.lot_amount_ranges import AmountRange
from labweb.domain.proof.plan_read import parse_plan
from labweb.domain.proof.plan_state import State
from tests.domain.recipes.plans import bench, claims, compiled, reasons, recipe, unproved
from tests.domain.recipes.test_advice import advised

UL = 10**9
ADD = 'Add vessel="reactor" reagent="water" volume="60 mL"'
SOLID = 'AddSolid vessel="reactor" reagent="salt" mass="2 g"'
ADJUST = 'AdjustPH vessel="reactor" reagent="acid" pH="3" step_volume="0.5 mL" max_volume="2.2 mL"'
DISTILL = 'Distill vessel="reactor" to_vessel="flask_spare" temp="90 °C" time="1 h"'
SONICATE = 'Sonicate vessel="reactor" time="5 min"'
MICROWAVE = 'Microwave vessel="reactor" temp="140 °C" time="10 min" stir="false"'
MONITOR = '<Repeat><Add vessel="reactor" reagent="water" volume="1 mL"/>{}</Repeat>'
PH = '<Monitor target="reactor" quantity="pH" {}/>'


def fitted(*devices: tuple[str, str, str], **capacity_ml: float) -> dict[str, Any]:
    """Draw the bench with more devices: id, class, and the vessels it is joined to."""
    graph = bench(**capacity_ml)
    for key, class_, vessels in devices:
        graph["nodes"].append({"id": key, "class": class_})
        for vessel in vessels.split():
            link = {"id": f"{key}_{vessel}", "source": key, "target": vessel, "port": "(,)"}
            graph["links"].append(link)
    return graph


def with_acid(**capacity_ml: float) -> dict[str, Any]:
    graph = fitted(("probe", "pHSensor", "reactor"), **capacity_ml)
    graph["nodes"].append({"id": "flask_acid", "class": "ChemputerFlask", "chemical": "acid"})
    link = {"id": "acid", "source": "flask_acid", "target": "valve_1", "port": "(0,4)"}
    graph["links"].append(link)
    return graph


def carried_out(plan: dict[str, Any], graph: dict[str, Any]) -> State:
    head = {"recipe": {"id": "recipe", "sha256": "0" * 64}, "graph_sha256": "0" * 64}
    rig = read_rig(json.dumps(graph).encode())
    return execute(rig, parse_plan(json.dumps(plan | head).encode()))


def acid(*steps: str, role: str = "") -> str:
    text = recipe(*steps, reagents=("water", "salt", "acid"))
    return text.replace('id="acid"', f'id="acid" role="{role}"') if role else text


def doubt(plan: dict[str, Any], graph: dict[str, Any]) -> set[str]:
    return {one.code for one in unproved(plan, read_rig(json.dumps(graph).encode()))}


def test_ultrasound_is_on_for_the_time_and_off_at_the_end() -> None:
    plan = compiled(recipe(ADD, SONICATE), fitted(("bath", "UltrasonicBath", "reactor")))
    kinds = [does["kind"] for does in claims(plan)][-3:]
    assert kinds == ["sonicate", "wait", "stop_sonicate"]
    assert reasons(recipe(ADD, SONICATE), bench()) == ["plan.no_ultrasound"]
    assert reasons(recipe(SONICATE), fitted(("bath", "UltrasonicBath", "reactor"))) == [
        "plan.nothing_there"
    ]


def test_a_microwave_asks_first_whether_the_vessel_is_closed() -> None:
    plan = compiled(recipe(ADD, MICROWAVE), fitted(("oven", "Microwave", "reactor")))
    (does,) = claims(plan, "microwave")
    assert does == {
        "kind": "microwave", "vessel": "reactor", "temperature_c": 140.0, "duration_s": 600.0,
    }  # fmt: skip
    first, second = plan["steps"][-1]["actions"]
    assert "bears the pressure" in first[0]["parameters"]["text"]
    assert second[0]["action"] == "heat_by_microwave"
    assert reasons(recipe(ADD, MICROWAVE), bench()) == ["plan.no_microwave"]


def spun() -> tuple[str, dict[str, Any]]:
    graph = bench()
    graph["nodes"].append({"id": "rotor", "class": "Centrifuge", "max_volume": 50})
    for one, two, port in (("rotor", "valve_1", "(0,4)"), ("valve_1", "rotor", "(4,0)")):
        graph["links"].append({"id": f"{one}{two}", "source": one, "target": two, "port": port})
    hardware = '<Component id="reactor" type="reactor"/><Component id="rotor" type="centrifuge"/>'
    text = recipe(
        'Add vessel="rotor" reagent="water" volume="20 mL"',
        'AddSolid vessel="rotor" reagent="ether" mass="1 g"',
        'Centrifuge vessel="rotor" time="5 min" speed="4000 RPM"',
        'Transfer from_vessel="rotor" to_vessel="reactor" volume="10 mL"',
        hardware=hardware,
    )
    return text, graph


def test_what_is_drawn_of_a_spun_vessel_holds_nobody_knows_how_much_of_the_solid() -> None:
    text, graph = spun()
    plan = compiled(text, graph)
    (does,) = claims(plan, "spin")
    assert (does["speed_rpm"], does["duration_s"]) == (4000.0, 300.0)
    held = carried_out(plan, graph).contents
    assert held["reactor"].volume == AmountRange.exactly(10_000 * UL)
    assert held["reactor"].solids == {"ether": AmountRange(0, 10**12)}
    assert held["rotor"].solids == {"ether": AmountRange(0, 10**12)}
    not_spun = compiled(text.replace("Centrifuge", "Wait").replace(' speed="4000 RPM"', "")
                        .replace('Wait vessel="rotor"', "Wait"), graph)  # fmt: skip
    assert carried_out(not_spun, graph).contents["reactor"].solids == {
        "ether": AmountRange.exactly(10**12 // 2)
    }


def test_only_a_centrifuge_spins() -> None:
    text = recipe(ADD, 'Centrifuge vessel="reactor" time="5 min" speed="4000 RPM"')
    assert reasons(text, bench()) == ["plan.no_centrifuge"]


def test_a_distillate_runs_into_the_vessel_that_the_condenser_leads_to() -> None:
    graph = fitted(("condenser", "Condenser", "reactor flask_spare"))
    plan = compiled(recipe(ADD, DISTILL), graph)
    (does,) = claims(plan, "distill")
    assert does == {
        "kind": "distill", "vessel": "reactor", "to": "flask_spare", "duration_s": 3600.0,
    }  # fmt: skip
    held = carried_out(plan, graph).contents
    for key in ("reactor", "flask_spare"):
        assert held[key].liquids == {"water": AmountRange(0, 60_000 * UL)}
    assert reasons(recipe(ADD, DISTILL), bench()) == ["plan.no_condenser"]
    elsewhere = fitted(("condenser", "Condenser", "reactor filter"))
    assert reasons(recipe(ADD, DISTILL), elsewhere) == ["plan.no_condenser"]
    without_end = DISTILL.replace(' time="1 h"', "")
    assert reasons(recipe(ADD, without_end), graph) == ["xdl.left_open"]


def test_a_receiver_that_may_be_too_small_is_asked_about() -> None:
    graph = fitted(("condenser", "Condenser", "reactor flask_spare"), flask_spare=20)
    plan = compiled(recipe(ADD, DISTILL), graph)
    step = next(s for s in plan["steps"] if s["does"]["kind"] == "distill")
    assert step["actions"][0][0]["action"] == "check"


def test_a_ph_is_adjusted_in_portions_and_never_with_more_than_allowed() -> None:
    graph = with_acid()
    plan = compiled(acid(ADD, ADJUST, role="acid"), graph)
    readings = claims(plan, "measure")
    assert len(readings) == 6
    assert all((does.get("low"), does["high"]) == (None, 3.1) for does in readings)
    portions = [does["volume_ul"] for does in claims(plan, "transfer") if does["lot"] == "acid"]
    assert portions == [500.0] * 4 + [200.0]
    assert plan["totals"]["delivered_ul"]["reactor"]["acid"] == 2200.0
    held = carried_out(plan, graph).contents["reactor"]
    assert held.liquids["acid"] == AmountRange(0, 2200 * UL)
    assert held.volume == AmountRange(60_000 * UL, 62_200 * UL)
    assert any("at most 2.2 mL of acid" in note for note in plan["notes"])


@pytest.mark.parametrize(
    ("role", "window"), [("acid", (None, 3.1)), ("base", (2.9, None)), ("", (2.9, 3.1))]
)
def test_an_acid_has_done_its_work_below_the_ph_and_a_base_above_it(
    role: str, window: tuple[float | None, float | None]
) -> None:
    plan = compiled(acid(ADD, ADJUST, role=role), with_acid())
    does = claims(plan, "measure")[0]
    assert (does.get("low"), does.get("high")) == window


def test_after_an_adjustment_what_follows_takes_all_of_it_into_account() -> None:
    after = 'Add vessel="reactor" reagent="water" volume="38 mL"'
    plan = compiled(acid(ADD, ADJUST, after), with_acid(reactor=100))
    step = next(s for s in plan["steps"] if s["does"].get("volume_ul") == 38_000.0)
    checks = [a for g in step["actions"] for a in g if a["action"] == "check"]
    assert [check["parameters"]["text"] for check in checks] == ["reactor has room for 38.00 mL"]
    too_much = 'Add vessel="reactor" reagent="water" volume="45 mL"'
    assert reasons(acid(ADD, ADJUST, too_much), with_acid(reactor=100)) == ["plan.overflow"]


@pytest.mark.parametrize(
    ("steps", "graph", "code"),
    [
        ((ADD, ADJUST), "bench", "plan.no_sensor"),
        ((ADD, ADJUST.replace("0.5 mL", "0.001 mL")), "acid", "plan.too_many_rounds"),
        ((ADD, ADJUST), "lamp", "plan.no_sensor"),
    ],
)
def test_an_adjustment_that_cannot_be_bounded_or_read_is_refused(
    steps: tuple[str, ...], graph: str, code: str
) -> None:
    drawn = with_acid()
    if graph != "acid":
        drawn["nodes"] = [n for n in drawn["nodes"] if n["id"] != "probe"]
        drawn["links"] = [n for n in drawn["links"] if n["source"] != "probe"]
    if graph == "lamp":
        drawn["nodes"].append({"id": "lamp", "class": "PhotoLamp"})
        link = {"id": "lamp", "source": "lamp", "target": "reactor", "port": "(,)"}
        drawn["links"].append(link)
    assert reasons(acid(*steps), drawn) == [code]


def loop(inner: str, *before: str) -> str:
    return acid(*before).replace("</Procedure>", f"{inner}</Procedure>")


def test_a_loop_that_a_reading_ends_goes_whole_rounds_and_is_bounded() -> None:
    graph = with_acid()
    plan = compiled(loop(MONITOR.format(PH.format('max="4"')), ADD), graph)
    assert len(claims(plan, "measure")) == 20
    assert carried_out(plan, graph).contents["reactor"].liquids["water"] == AmountRange(
        61_000 * UL, 80_000 * UL
    )
    assert any("repeat.most_rounds" in note for note in plan["notes"])
    first = [s for s in plan["steps"] if "skip_if" not in s]
    assert sum(s["does"]["kind"] == "measure" for s in first) == 1


def test_a_flask_that_a_loop_may_have_left_full_is_looked_at_before_more_is_filled_in() -> None:
    more = '<Add vessel="reactor" reagent="water" volume="5 mL"/>'
    text = loop(MONITOR.format(PH.format('max="4"')) + more)
    plan = compiled(text, with_acid(flask_water=20))
    filled = [step["actions"] for step in plan["steps"] if step["does"]["kind"] == "fill"]
    asked = [[a["parameters"]["text"] for group in one for a in group] for one in filled]
    assert asked == [
        ["Fill 20.00 mL of water into flask_water"],
        ["flask_water has room for 5.00 mL", "Fill 5.00 mL of water into flask_water"],
    ]


@pytest.mark.parametrize(
    ("inner", "code"),
    [
        ("<Repeat>{ph}<StartStir vessel='reactor'/></Repeat>", ""),
        ("<Repeat>{ph}<Repeat>{ph}</Repeat></Repeat>", "plan.open_loop"),
        ("<Loop><Wait time='1 s'/></Loop>", "plan.open_loop"),
    ],
)
def test_what_loops_may_hold(inner: str, code: str) -> None:
    text = loop(inner.format(ph=PH.format('max="4"')), ADD)
    if code:
        assert code in reasons(text, with_acid())
    else:
        compiled(text, with_acid())


def spoil(plan: dict[str, Any], what: str) -> None:
    rounds = [step for step in plan["steps"] if "skip_if" in step]
    if what == "skipped":
        early = next(step for step in rounds if step["does"]["kind"] == "measure")
        last = rounds[-1]["skip_if"]
        for step in rounds:
            step["skip_if"] = [early["id"]] if step["skip_if"] == last else step["skip_if"]
    elif what == "no reading":
        rounds[0]["skip_if"] = [1]
    elif what == "not waited for":
        rounds[0]["after"] = []
    elif what == "certain":
        for step in rounds:
            del step["skip_if"]
    elif what == "stirred":
        device = {"device": "stirrer_r", "action": "stir", "parameters": {"speed_rpm": 100}}
        does = {"kind": "stir", "vessel": "reactor", "speed_rpm": 100}
        rounds[-1] |= {"does": does, "actions": [[device]]}


@pytest.mark.parametrize(
    ("what", "code"),
    [
        ("skipped", "interpret.rounds"),
        ("no reading", "interpret.rounds"),
        ("not waited for", "interpret.unordered"),
        ("stirred", "interpret.rounds"),
    ],
)
def test_the_verifier_sees_rounds_that_do_not_hold_together(what: str, code: str) -> None:
    graph = with_acid()
    plan = deepcopy(compiled(acid(ADD, ADJUST), graph))
    spoil(plan, what)
    assert code in doubt(plan, graph)


def test_the_verifier_believes_a_draw_only_when_every_number_of_rounds_has_it() -> None:
    graph = with_acid()
    after = 'Transfer from_vessel="reactor" to_vessel="filter" volume="62 mL"'
    plan = compiled(acid(ADD, ADJUST, after), graph)
    step = next(s for s in plan["steps"] if s["does"].get("to") == "filter")
    assert step["actions"][0][0]["parameters"]["least_ul"] == 62_000.0
    step["actions"] = step["actions"][1:]
    plan["totals"]["by_hand_count"] -= 1
    assert "interpret.dry_draw" in doubt(plan, graph)


@pytest.mark.parametrize(
    ("does", "field", "value"),
    [("spin", "speed_rpm", 1.0), ("spin", "duration_s", 1.0)],
)
def test_the_verifier_compares_what_a_centrifuge_does(does: str, field: str, value: float) -> None:
    text, graph = spun()
    plan = compiled(text, graph)
    next(s for s in plan["steps"] if s["does"]["kind"] == does)["does"][field] = value
    assert "interpret.claim" in doubt(plan, graph)


def test_the_verifier_wants_a_distilled_vessel_heated() -> None:
    graph = fitted(("condenser", "Condenser", "reactor flask_spare"))
    plan = compiled(recipe(ADD, DISTILL), graph)
    for step in plan["steps"]:
        if step["does"]["kind"] == "heat":
            step["does"] = {"kind": "wait", "duration_s": 1}
            wait = {"device": "@timer", "action": "wait", "parameters": {"duration_s": 1}}
            step["actions"] = [[wait]]
    assert "interpret.claim" in doubt(plan, graph)


def test_a_column_may_lead_into_the_collecting_flask() -> None:
    graph = bench()
    graph["nodes"] += [
        {"id": "rotavap", "class": "IKARV10", "collection_flask_volume": 250},
        {"id": "silica", "class": "ChemputerCartridge", "chemical": "silica"},
    ]
    for one, two, port in (
        ("valve_1", "silica", "(4,in)"),
        ("silica", "rotavap", "(out,collect)"),
    ):
        graph["links"].append({"id": f"{one}{two}", "source": one, "target": two, "port": port})
    hardware = '<Component id="reactor" type="reactor"/><Component id="rotavap" type="rotavap"/>'
    column = 'RunColumn from_vessel="reactor" to_vessel="rotavap" column="silica"'
    plan = compiled(recipe(ADD, f'{column} to_port="collect"', hardware=hardware), graph)
    (does,) = claims(plan, "transfer")[1:]
    assert (does["to"], does["through"]) == ("rotavap#collect", ["silica"])
    held = carried_out(plan, graph).contents
    assert held["rotavap#collect"].volume == AmountRange.exactly(60_000 * UL)


@pytest.mark.parametrize("step", [SONICATE, MICROWAVE, DISTILL])
def test_a_device_that_is_missing_is_one_change(step: str) -> None:
    assert advised(recipe(ADD, step), bench()) == ["attach"]
