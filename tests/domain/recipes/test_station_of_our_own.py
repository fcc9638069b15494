"""The synthesis of two steps on the lab file of its station: compiled, proved, played.

```text
      argon ─┐
  reactor ─ valve ─ vacuum        evaporator ▸ turns flask ══ vapour ══▸ receiver
                                               vacuum ─┘
```
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.graph.rig.lab_as_rig import render_graph
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.proof.execute_plan import execute
from labweb.domain.proof.plan_read import parse_plan
from labweb.domain.recipes.advise.fewest_changes import Advice, advise
from labweb.domain.recipes.recipe_preview import PreviewAsked, open_recipe
from labweb.domain.recipes.recipe_to_plan import CompileWish
from labweb.domain.recipes.xdl.file_format.read_xdl import read_xdl
from labweb.domain.recipes.xdl.lab_choices.declarations_file import bindings, read_declared
from labweb.domain.workflows.compile_workflow import compile_workflow
from tests.domain.recipes.plans import claims, compiled, reasons, recipe, unproved
from tests.domain.workflows.station import DECLARED, recipe_document, station_file, workflow
from tests.domain.workflows.station import station as view

LAB = Path(__file__).parents[3] / "fixtures/labs/organic_synthesis"
RECIPE = (LAB / "protocols/benzhydryl_acetate.xdl").read_bytes()
WISH = CompileWish(bind=bindings(read_declared(DECLARED.read_bytes()), read_xdl(RECIPE)))
UL = 10**9
"""Units of the verifier in a microlitre."""

DRIVERS_SAY = {
    "aspirate": {"aspirate"},
    "dispense": {"dispense"},
    "set_port": {"select_port"},
    "stir": {"stir"},
    "stop_stirring": {"stop_stirring"},
    "set_temperature": {"reach_temperature", "heat_bath_to"},
    "await_temperature": {"reach_temperature", "heat_bath_to"},
    "stop_temperature": {"stop_control", "stop_heating"},
    "start_vacuum": {"evacuate_to"},
    "stop_vacuum": {"stop_pump"},
    "vent": {"vent"},
    "start_rotation": {"rotate"},
    "stop_rotation": {"stop_rotating"},
    "lower_flask": {"lower_flask"},
    "raise_flask": {"raise_flask"},
    "evaporate": {"rotate", "heat_bath_to"},
    "watch_boundary": {"measure"},
    "stop_watching": {"measure"},
}
"""Action of a plan → the actions of drivers that can carry it out."""


def lab() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((LAB / "lab.json").read_text("utf-8"))
    return found


@cache
def whole() -> dict[str, Any]:
    return compiled(RECIPE, lab(), WISH)


def without(key: str) -> dict[str, Any]:
    """Take a resource out of the lab, with its tubes and its driver."""
    graph = lab()
    graph["resources"] = [one for one in graph["resources"] if one["key"] != key]
    graph["connections"] = [
        one
        for one in graph["connections"]
        if key not in (one["source"]["resource"], one["target"]["resource"])
    ]
    graph["devices"] = [one for one in graph["devices"] if key not in one["nodes"].values()]
    return graph


def resource(graph: dict[str, Any], key: str) -> dict[str, Any]:
    found: dict[str, Any] = next(one for one in graph["resources"] if one["key"] == key)
    return found


def connection(graph: dict[str, Any], key: str) -> dict[str, Any]:
    found: dict[str, Any] = next(one for one in graph["connections"] if one["key"] == key)
    return found


def actions(plan: dict[str, Any]) -> list[dict[str, Any]]:
    return [c for step in plan["steps"] for group in step["actions"] for c in group]


def test_both_steps_are_compiled_and_proved() -> None:
    plan = whole()
    assert len(claims(plan, "separate")) == 3
    assert [does["vessel"] for does in claims(plan, "evaporate")] == ["rotavap_flask"] * 2
    assert [does["gas"] for does in claims(plan, "gas")] == ["argon"] * 3
    through = [does["through"] for does in claims(plan, "transfer") if "through" in does]
    assert through == [["cartridge_silica"]] * 3
    parted = claims(plan, "separate")
    dried = [does.get("upper_through") or does.get("lower_through") for does in parted]
    assert dried == [None, ["cartridge_mgso4"], ["cartridge_mgso4"]]
    assert plan["bindings"]["vessels"]["rotavap"] == "rotavap_flask"


def test_the_evaporator_is_told_and_its_flask_is_what_it_acts_on() -> None:
    plan = whole()
    told = {c["action"]: c["device"] for c in actions(plan) if c["device"] == "rotavap"}
    assert told.keys() == {
        *("start_rotation", "stop_rotation", "lower_flask", "raise_flask", "evaporate"),
        *("set_temperature", "await_temperature", "stop_temperature"),
    }
    pressures = [
        (c["device"], c["parameters"]["pressure_mbar"])
        for c in actions(plan)
        if c["action"] == "start_vacuum"
    ]
    assert pressures == [("vacuum_line", 50.0)] * 3 + [
        ("vacuum_rotavap", 50.0),
        ("vacuum_rotavap", 10.0),
    ]


def test_vapour_condenses_in_the_receiver_and_is_drained_from_there() -> None:
    plan = whole()
    first = next(n for n, s in enumerate(plan["steps"]) if s["does"]["kind"] == "evaporate")
    head = {"recipe": {"id": "recipe", "sha256": "0" * 64}, "graph_sha256": "0" * 64}
    part = plan | head | {"steps": plan["steps"][: first + 1], "totals": {}}
    state = execute(read_rig(json.dumps(lab()).encode()), parse_plan(json.dumps(part).encode()))
    held = state.contents["rotavap_receiver"]
    assert held.liquids["diethyl ether"].most == 40_000 * UL
    assert "rotavap_flask#collect" not in state.contents
    drained = [
        does["to"] for does in claims(plan, "transfer") if does["from"] == "rotavap_receiver"
    ]
    assert drained == ["waste"] * 2


def test_the_gas_valve_rests_where_it_has_a_port_and_no_tube() -> None:
    ports = [c["parameters"]["port"] for c in actions(whole()) if c["device"] == "valve_gas"]
    assert ports == ["1", "2", "2", "3"] * 3


def test_every_action_is_one_that_the_driver_at_that_place_has() -> None:
    drivers = {node: device for device in view().devices for node in device.nodes.values()}
    keys = {one.key: one.id for one in station_file().resources}
    for action in actions(whole()):
        if action["device"].startswith("@"):
            continue
        device = drivers[keys[action["device"]]]
        has = {one.name for one in device.spec.actions}
        assert has & DRIVERS_SAY[action["action"]], (device.key, action["action"])


def test_the_instruments_are_those_of_the_run() -> None:
    run = compile_workflow(workflow(recipe_document()), view())
    used = {job.device_id for job in run.jobs}
    keys = {one.key: one.id for one in station_file().resources}
    drivers = {node: device for device in view().devices for node in device.nodes.values()}
    planned = {drivers[keys[c["device"]]].id for c in actions(whole()) if c["device"] in keys}
    names = {device.id: device.key for device in view().devices}
    assert {names[one] for one in used - planned} == {"timer_1"}
    assert {names[one] for one in planned - used} == {"sensor_separator"}


def test_the_lab_as_the_server_writes_it_is_opened_and_planned() -> None:
    graph = render_graph(station_file())
    opened = open_recipe(PreviewAsked(name="one", recipe=RECIPE, graph=graph, bind=WISH.bind))
    assert (opened["findings"], opened["is_proved"]) == ([], True)
    assert len(opened["plan"]["steps"]) == len(whole()["steps"])


def renamed() -> tuple[dict[str, Any], dict[str, str]]:
    """Give every resource another key."""
    graph = lab()
    new = {one["key"]: f"x{place:02}" for place, one in enumerate(graph["resources"])}
    for one in graph["resources"]:
        one["key"], one["name"] = new[one["key"]], new[one["key"]]
        one["parent"] = one["parent"] and new[one["parent"]]
    for one in graph["connections"]:
        for end in ("source", "target"):
            one[end]["resource"] = new[one[end]["resource"]]
    for one in graph["devices"]:
        one["nodes"] = {role: new[key] for role, key in one["nodes"].items()}
    return graph, new


def test_a_reagent_is_used_as_much_as_in_the_run() -> None:
    run, plan = compile_workflow(workflow(recipe_document()), view()), whole()
    keys = {one.id: one.key for one in station_file().resources}
    drawn: dict[str, int] = {}
    for job in run.jobs:
        if job.action == "aspirate" and isinstance(job.operation, TransferLiquid):
            source = keys[job.operation.source_id]
            drawn[source] = drawn.get(source, 0) + job.operation.amount_nl
    bottles = {plan["bindings"]["reagents"][lot]: ul for lot, ul in needed(plan).items()}
    assert bottles == {key: nl / 1000 for key, nl in drawn.items() if key.startswith("bottle")}


def needed(plan: dict[str, Any]) -> dict[str, float]:
    found: dict[str, float] = plan["totals"]["needed_ul"]
    return found


def test_a_device_without_a_driver_is_told() -> None:
    graph = lab()
    graph["devices"] = [one for one in graph["devices"] if one["key"] != "cryostat"]
    told = compiled(RECIPE, graph, WISH)["notes"]
    assert [text.partition(":")[0] for text in told if "driver" in text] == [
        "no driver drives cryostat"
    ]
    assert not [text for text in whole()["notes"] if "driver" in text]


@pytest.mark.parametrize("rpm", ["1001", "5000"])
def test_a_speed_that_a_stirrer_does_not_reach_is_refused(rpm: str) -> None:
    steps = f'Stir vessel="reactor" time="5 min" stir_speed="{rpm} RPM"'
    text = recipe('Add vessel="reactor" reagent="water" volume="5 mL"', steps)
    wish = CompileWish(bind={"water": "bottle_water", "filter": "crude"})
    assert reasons(text, lab(), wish) == ["plan.out_of_range"]


def test_advice_brings_a_receiver_and_takes_no_flask_that_is_there_for_one() -> None:
    graph = lab()
    _no_vapour(graph)
    rig = read_rig(json.dumps(graph).encode())
    found = advise(read_xdl(RECIPE), rig, WISH)
    assert isinstance(found, Advice)
    (change,) = found.changes
    assert (change["change"], change["adds"]) == ("add_receiver", ["rotavap_flask_receiver"])
    keys = {entry["key"] for entry in json.loads(found.graph)["resources"]}
    assert keys == {entry["key"] for entry in graph["resources"]} | set(change["adds"])


def test_names_say_nothing() -> None:
    graph, new = renamed()
    own = {"reactor": "reactor", "separator": "separator", "crude": "crude"}
    wish = CompileWish(bind={name: new[key] for name, key in {**WISH.bind, **own}.items()})
    plan, plain = compiled(RECIPE, graph, wish), whole()
    kinds = [step["does"]["kind"] for step in plan["steps"]]
    assert kinds == [step["does"]["kind"] for step in plain["steps"]]
    does = [(c["action"], new.get(c["device"], c["device"])) for c in actions(plain)]
    assert [(c["action"], c["device"]) for c in actions(plan)] == does


@pytest.mark.parametrize(
    ("key", "code"),
    [
        ("cryostat", "plan.no_thermostat"),
        ("stirrer_separator", "plan.no_stirrer"),
        ("cartridge_silica", "plan.no_cartridge"),
        ("argon", "plan.no_gas"),
        ("vacuum_line", "plan.no_vacuum"),
        ("vacuum_rotavap", "plan.no_vacuum"),
        ("rotavap_receiver", "plan.no_condenser"),
    ],
)
def test_a_part_that_is_missing_is_named(key: str, code: str) -> None:
    assert code in reasons(RECIPE, without(key), WISH)


def _not_on_the_evaporator(graph: dict[str, Any]) -> None:
    resource(graph, "rotavap_flask")["parent"] = "bench_1"


def _of_nothing(graph: dict[str, Any]) -> None:
    resource(graph, "argon")["config"] = {}


def _of_another_gas(graph: dict[str, Any]) -> None:
    resource(graph, "argon")["config"] = {"gas": "nitrogen"}


def _unfilled(graph: dict[str, Any]) -> None:
    resource(graph, "cartridge_silica")["config"] = {}


def _no_vapour(graph: dict[str, Any]) -> None:
    connection(graph, "rotavap_flask_rotavap_receiver")["medium"] = "electrical"


def _liquid_to_the_gas(graph: dict[str, Any]) -> None:
    connection(graph, "argon_valve_gas_2")["medium"] = "liquid"


def _no_vacuum(graph: dict[str, Any]) -> None:
    connection(graph, "valve_gas_1_vacuum_line")["medium"] = "electrical"


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (_not_on_the_evaporator, "plan.wrong_kind"),
        (_of_nothing, "plan.no_gas"),
        (_of_another_gas, "plan.no_gas"),
        (_unfilled, "plan.no_cartridge"),
        (_no_vapour, "plan.no_condenser"),
        (_no_vacuum, "plan.no_vacuum"),
        (_liquid_to_the_gas, "plan.no_gas"),
    ],
)
def test_what_the_lab_does_not_state_is_not_taken_from_a_name(
    change: Callable[[dict[str, Any]], None], code: str
) -> None:
    graph, bound = lab(), {n: k for n, k in WISH.bind.items() if n != "silica"}
    change(graph)
    assert code in reasons(RECIPE, graph, CompileWish(bind=bound))


def test_a_cartridge_is_chosen_by_hand_where_the_lab_says_no_filling() -> None:
    graph = lab()
    _unfilled(graph)
    plan = compiled(RECIPE, graph, WISH)
    through = [does["through"] for does in claims(plan, "transfer") if "through" in does]
    assert through == [["cartridge_silica"]] * 3


def _device(plan: dict[str, Any], name: str, device: str) -> None:
    next(c for c in actions(plan) if c["action"] == name)["device"] = device


@pytest.mark.parametrize(
    ("name", "device"),
    [
        ("evaporate", "cryostat"),
        ("evaporate", "rotavap_flask"),
        ("lower_flask", "stirrer_reactor"),
        ("start_rotation", "stirrer_separator"),
        ("start_vacuum", "vacuum_rotavap"),
        ("set_temperature", "rotavap"),
    ],
)
def test_the_verifier_finds_what_another_device_does(name: str, device: str) -> None:
    plan = json.loads(json.dumps(whole()))
    _device(plan, name, device)
    assert unproved(plan, read_rig(json.dumps(lab()).encode()))


def test_the_verifier_finds_what_is_drawn_from_the_receiver_under_vacuum() -> None:
    plan = json.loads(json.dumps(whole()))
    steps = plan["steps"]
    place = next(n for n, s in enumerate(steps) if s["does"].get("from") == "rotavap_receiver")
    assert steps[place - 1]["does"]["kind"] == "vent"
    vent, drain = steps[place - 1], steps[place]
    for name in ("does", "actions"):
        vent[name], drain[name] = drain[name], vent[name]
    found = unproved(plan, read_rig(json.dumps(lab()).encode()))
    assert "interpret.vacuum_on" in {one.code for one in found}
