"""A recipe that is opened on a rig says all that is known of it, and no plan that is not proved."""

from __future__ import annotations

import gzip
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from labweb.domain.errors import Finding, LabError
from labweb.domain.graph.lab_file.lab_json_read import read_lab
from labweb.domain.graph.lab_file.lab_json_write import render_lab
from labweb.domain.graph.rig.lab_as_rig import render_graph
from labweb.domain.graph.rig.rig_read import read_rig
from labweb.domain.proof.prove_plan import Proof
from labweb.domain.recipes import compile_recipe_file
from labweb.domain.recipes.recipe_preview import PreviewAsked, advise_on, open_recipe, workflow_from

LABS = Path(__file__).parents[3] / "fixtures/labs"
RECIPE = (LABS / "three_stations/protocols/acetylation.xdl").read_bytes()
ROW = (LABS / "three_stations/row.json").read_bytes()
ASKED = PreviewAsked(name="acetylation", recipe=RECIPE, graph=ROW)

WATER = b"""<XDL><Synthesis><Hardware><Component id="reactor" type="reactor"/></Hardware>
<Reagents><Reagent name="Water"/></Reagents>
<Procedure>
  <Add vessel="reactor" reagent="Water" volume="2 mL"/>
  <HeatChillToTemp vessel="reactor" temp="40 \xc2\xb0C" stir="false"/>
</Procedure></Synthesis></XDL>"""
STARTER = (LABS / "starter/lab.json").read_bytes()


def binding(answer: dict[str, Any], role: str) -> dict[str, Any]:
    return next(row for row in answer["bindings"] if row["role"] == role)


def without(graph: bytes, *keys: str) -> bytes:
    value = json.loads(graph)
    links = "links" if "links" in value else "edges"
    value["nodes"] = [node for node in value["nodes"] if node["id"] not in keys]
    value[links] = [link for link in value[links] if not {link["source"], link["target"]} & {*keys}]
    return json.dumps(value).encode()


def test_a_plan_comes_with_what_is_bound_and_with_every_route() -> None:
    answer = open_recipe(ASKED)
    assert (answer["findings"], answer["is_proved"]) == ([], True)
    assert binding(answer, "water")["keys"] == ["flask_water"]
    assert binding(answer, "separator")["choices"] == ["separator"]
    assert "4-nitrobenzyl alcohol" not in {row["role"] for row in answer["bindings"]}
    tubes = {tube["key"]: tube for tube in answer["rig"]["tubes"]}
    for step in answer["plan"]["steps"]:
        moves = any(a["action"] == "dispense" for group in step["actions"] for a in group)
        assert bool(step["route"]) == moves
        if not moves:
            continue
        ends = {tubes[key][end] for key in step["route"] for end in ("source", "target")}
        used = {a["device"] for group in step["actions"] for a in group} - {"@by_hand"}
        assert {key for key in used if key.startswith(("valve", "pump"))} <= ends
        named = {step["does"].get(name) for name in ("from", "to", "lower_to", "upper_to")}
        assert named - {None} <= ends


def test_a_route_goes_through_the_ports_that_valves_are_turned_to() -> None:
    answer = open_recipe(ASKED)
    tubes = {tube["key"]: tube for tube in answer["rig"]["tubes"]}
    step = next(
        s
        for s in answer["plan"]["steps"]
        if s["does"].get("lot") == "acetyl chloride" and s["does"]["kind"] == "transfer"
    )
    turned = {
        (a["device"], a["parameters"]["port"])
        for group in step["actions"]
        for a in group
        if a["action"] == "set_port"
    }
    joined = {
        (tubes[key][end], tubes[key][f"{end}_port"])
        for key in step["route"]
        for end in ("source", "target")
    }
    assert turned <= joined
    at_valves = {(key, port) for key, port in joined if key.startswith("valve") and port != "-1"}
    assert at_valves == turned


def test_a_finding_says_line_and_column_and_there_is_no_plan() -> None:
    answer = open_recipe(
        replace(
            ASKED,
            recipe=RECIPE.replace(b'reagent="water"', b'reagent="w"').replace(
                b'solvent="water"', b'solvent="watr"'
            ),
        )
    )
    (finding,) = answer["findings"]
    assert finding["about"] == "recipe"
    assert finding["context"]["line"] == 23
    assert answer["plan"] is None
    assert [row["keys"] for row in answer["bindings"]] == [[]] * len(answer["bindings"])
    assert "flask_water" in binding(answer, "water")["choices"]


def test_what_is_bound_by_hand_is_what_the_plan_uses() -> None:
    by_hand = replace(ASKED, bind={"water": "flask_dcm"})
    answer = open_recipe(by_hand)
    assert binding(answer, "water")["is_by_hand"]
    assert answer["plan"] is None or answer["plan"]["bindings"]["reagents"]["water"] == "flask_dcm"
    unknown = open_recipe(replace(ASKED, bind={"water": "nowhere"}))
    assert {f["code"] for f in unknown["findings"]} >= {"plan.unknown_vessel"}


def test_a_plan_that_is_not_proved_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = Finding("interpret.overflow", "step 7: it is too full", "step 7")
    monkeypatch.setattr(compile_recipe_file, "prove", lambda *_: Proof((wrong,)))
    answer = open_recipe(ASKED)
    assert (answer["plan"], answer["is_proved"]) == (None, False)
    assert [f["code"] for f in answer["findings"]] == ["plan.not_proved", "interpret.overflow"]


def test_a_graph_that_cannot_be_read_is_told_and_the_recipe_is_read_all_the_same() -> None:
    answer = open_recipe(replace(ASKED, graph=b"{}"))
    assert [f["about"] for f in answer["findings"]] == ["graph"]
    assert (answer["rig"], answer["recipe"]["steps_count"]) == (None, 6)
    assert (
        open_recipe(replace(ASKED, graph=b"\x1f\x8bno"))["findings"][0]["code"] == "lab_file.gzip"
    )


def test_a_packed_graph_is_the_graph() -> None:
    packed = open_recipe(replace(ASKED, graph=gzip.compress(ROW)))
    assert packed["plan"] == open_recipe(ASKED)["plan"]


@pytest.mark.parametrize(
    ("recipe", "code"),
    [
        (b"<XDL>", "xdl.markup"),
        (b'<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><XDL>&a;</XDL>', "xdl.doctype"),
        (b"\xff\xfeno", "xdl.markup"),
    ],
)
def test_what_is_no_recipe_is_a_finding_in_the_answer(recipe: bytes, code: str) -> None:
    answer = open_recipe(replace(ASKED, recipe=recipe))
    assert [f["code"] for f in answer["findings"]] == [code]
    assert answer["recipe"] is None


def test_what_a_vessel_holds_needs_a_unit() -> None:
    answer = open_recipe(replace(ASKED, holds={"reactor": {"water": "20"}}))
    assert [f["about"] for f in answer["findings"]] == ["wish"]
    held = open_recipe(replace(ASKED, holds={"product": {"water": "20 mL"}}))
    assert held["plan"] is None or held["plan"]["contents"]["product"][0]["volume_ul"] == 20_000


def test_advice_comes_with_a_graph_on_which_the_recipe_compiles() -> None:
    lacking = replace(ASKED, graph=without(ROW, "flask_water"))
    assert {f["code"] for f in open_recipe(lacking)["findings"]} >= {"plan.no_reagent"}
    advice = advise_on(lacking)
    assert advice["ok"]
    corrected = open_recipe(replace(ASKED, graph=advice["graph"].encode()))
    assert corrected["is_proved"]
    assert corrected["rig"]["sha256"] == advice["graph_sha256"]


def test_a_lab_of_ours_is_a_rig_too() -> None:
    answer = open_recipe(PreviewAsked(name="warm", recipe=WATER, graph=STARTER))
    assert (answer["findings"], answer["is_proved"]) == ([], True)
    assert binding(answer, "reactor")["keys"] == ["reactor_1"]
    assert answer["plan"]["steps"][0]["does"]["kind"]
    assert any(step["route"] for step in answer["plan"]["steps"])
    assert read_rig(STARTER).format.value == answer["rig"]["format"]


def test_a_lab_is_a_rig_whatever_its_instruments_are_reached_by() -> None:
    lab = read_lab(STARTER)
    real = replace(lab.devices[0], simulator=None, transport="serial:///dev/ttyUSB0")
    mixed = replace(lab, devices=(real, *lab.devices[1:]))
    with pytest.raises(LabError, match="simulator for every device"):
        read_rig(render_lab(mixed))
    one, other = read_rig(render_graph(mixed)), read_rig(STARTER)
    assert (one.elements, one.tubes) == (other.elements, other.tubes)


def test_a_workflow_takes_the_keys_that_are_bound_or_is_refused_whole() -> None:
    keys = {"Water": "water", "reactor": "reactor_1"}
    found = workflow_from(PreviewAsked(name="warm", recipe=WATER, graph=STARTER, bind=keys))
    assert found["document"]["steps"][0]["params"]["target"] == "@reactor_1"
    assert found["proved"]["sources"] == {"water": "Water"}
    with pytest.raises(LabError) as refusal:
        workflow_from(PreviewAsked(name="acetylation", recipe=RECIPE, graph=ROW))
    assert {finding.code for finding in refusal.value.findings} >= {"xdl.not_a_key"}


def test_on_the_lab_a_recipe_is_a_workflow_too_but_not_with_a_reagent_in_two_flasks() -> None:
    asked = PreviewAsked(name="warm", recipe=WATER, graph=STARTER, is_of_lab=True)
    document = open_recipe(asked)["document"]
    assert [step["kind"] for step in document["steps"]] == [
        "transfer",
        "heat_chill",
        "stop_heat_stir",
    ]
    assert open_recipe(PreviewAsked(name="warm", recipe=WATER, graph=STARTER))["document"] is None
    two = json.loads(STARTER)
    water = next(lot["material"] for lot in two["lots"] if lot["key"] == "water_lot")
    for lot in two["lots"]:
        lot["material"] = water
    graph = json.dumps(two).encode()
    answer = open_recipe(PreviewAsked(name="warm", recipe=WATER, graph=graph, is_of_lab=True))
    several = [row for row in answer["bindings"] if len(row["keys"]) > 1]
    assert (len(several), answer["document"]) == (1, None)
    assert not [one for one in answer["findings"] if one["about"] == "workflow"]
