"""Recipes over REST: opened on the lab or on a graph, advised on, kept as a workflow."""

from __future__ import annotations

import gzip
import hashlib
import json
from threading import BoundedSemaphore
from typing import Any

import pytest
from django.db import connection
from django.test import Client

from labweb.accounts.models import User
from labweb.common.recipes import __main__ as process
from labweb.domain.errors import LockedError
from labweb.domain.recipes.recipe_preview import PreviewAsked
from labweb.workflows.models import Workflow, WorkflowVersion
from labweb.workflows.services import recipes
from tests.builders import Bench
from tests.domain.recipes.test_opening import RECIPE, ROW, WATER, without
from tests.labweb.web import code_of, signed_in
from tests.labweb.workflows.asking import opened, packed, post


def test_a_recipe_is_planned_on_the_lab_as_it_is_and_nothing_is_stored(
    bench: Bench, chemist: Client
) -> None:
    answer = opened(chemist, name="warm", recipe=packed(WATER))
    assert answer["is_proved"] is True
    assert answer["plan"]["bindings"]["vessels"] == {"reactor": "reactor_1"}
    keys = {node["key"] for node in answer["rig"]["nodes"]}
    assert {"water", "valve_1", "pump_1"} <= keys
    assert not Workflow.objects.filter(is_template=False).exists()


def test_on_the_lab_its_workflow_is_checked_as_a_start_does(bench: Bench, chemist: Client) -> None:
    answer = opened(chemist, name="warm", recipe=packed(WATER))
    first = answer["document"]["steps"][0]
    assert first["params"]["source"] == str(bench.node("water").id)
    check = {"document": answer["document"], "workflow_id": None}
    told = chemist.post("/api/v1/workflows/check", check, content_type="application/json").json()
    assert (told["findings"], told["plan"] is None) == ([], False)


def test_what_a_workflow_cannot_say_is_told_when_it_is_opened(chemist: Client) -> None:
    more = b'<StartHeatChill vessel="reactor" temp="40 C"/></Procedure>'
    answer = opened(chemist, name="warm", recipe=packed(WATER.replace(b"</Procedure>", more)))
    assert (answer["is_proved"], answer["document"]) == (True, None)
    (found,) = answer["findings"]
    assert (found["about"], found["code"]) == ("workflow", "xdl.not_in_workflow")


def test_another_graph_gives_another_plan(chemist: Client) -> None:
    answer = opened(chemist, name="acetylation", recipe=packed(RECIPE), graph=packed(ROW))
    assert (answer["is_proved"], answer["document"]) == (True, None)
    assert answer["plan"]["recipe"]["id"] == "acetylation"
    refused = opened(chemist, name="acetylation", recipe=packed(RECIPE))
    assert refused["plan"] is None
    assert {f["code"] for f in refused["findings"]} >= {"plan.no_reagent", "plan.no_vessel"}


def test_what_is_hostile_ends_as_a_finding(chemist: Client) -> None:
    bomb = b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">]><XDL>&a;</XDL>'
    answer = opened(chemist, name="x", recipe=packed(bomb), graph=packed(ROW))
    assert [f["code"] for f in answer["findings"]] == ["xdl.doctype"]
    large = post(chemist, "open", name="x", recipe="A" * 3_000_000)
    assert large.status_code == 413
    assert code_of(post(chemist, "open", name="x", recipe="no base64!")) == "http.body"
    assert code_of(post(chemist, "open", name="x", recipe="", lab="other")) == "http.body"


def test_advice_comes_with_the_corrected_graph(chemist: Client) -> None:
    answer = post(
        chemist,
        "advise",
        name="acetylation",
        recipe=packed(RECIPE),
        graph=packed(without(ROW, "flask_water")),
    )
    advice = json.loads(answer.content)
    assert (answer.status_code, advice["ok"]) == (200, True)
    assert advice["changes"][0]["change"] == "add_flask"
    assert any(node.get("chemical") == "water" for node in json.loads(advice["graph"])["nodes"])


def test_a_recipe_is_kept_as_a_version_with_where_it_came_from(
    bench: Bench, chemist: Client
) -> None:
    keys = {"Water": "water", "reactor": "reactor_1"}
    answer = post(
        chemist, "keep", name="Warm water", recipe=packed(WATER), file="warm.xdl", bind=keys
    )
    told = json.loads(answer.content)
    assert answer.status_code == 201, told
    version = WorkflowVersion.objects.get(pk=told["version"]["id"])
    assert (version.number, str(version.workflow_id)) == (1, told["workflow_id"])
    assert version.note.startswith("from warm.xdl, SHA-256 ")
    assert version.author == bench.people["chemist"]
    transfer, heat, stop = version.document["steps"]
    kinds = [step["kind"] for step in (transfer, heat, stop)]
    assert kinds == ["transfer", "heat_chill", "stop_heat_stir"]
    assert transfer["params"]["source"] == str(bench.node("water").id)
    assert heat["params"]["vessel"] == str(bench.node("reactor_1").id)


def test_a_vessel_that_the_lab_does_not_have_keeps_nothing(bench: Bench, chemist: Client) -> None:
    before = Workflow.objects.count()
    keys = {"Water": "water", "reactor": "elsewhere"}
    answer = post(chemist, "keep", name="Warm", recipe=packed(WATER), bind=keys)
    assert (answer.status_code, code_of(answer)) == (422, "plan.unknown_vessel")
    assert Workflow.objects.count() == before


def test_what_the_lab_cannot_do_is_refused_whole(bench: Bench, chemist: Client) -> None:
    before = Workflow.objects.count()
    answer = post(chemist, "keep", name="Ester", recipe=packed(RECIPE))
    found = json.loads(answer.content)
    assert answer.status_code == 422
    assert {f["code"] for f in found["findings"]} >= {"plan.no_reagent"}
    assert all(f["context"].get("line") for f in found["findings"])
    assert Workflow.objects.count() == before


def test_an_observer_opens_nothing_and_keeps_nothing(bench: Bench) -> None:
    observer = signed_in(bench.people["observer"])
    for act in ("open", "advise", "keep"):
        assert post(observer, act, name="warm", recipe=packed(WATER)).status_code == 403


def test_more_recipes_than_the_server_compiles_wait_and_are_told_so(
    chemist: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recipes, "_AT_ONCE", BoundedSemaphore(1))
    monkeypatch.setattr(recipes, "WAIT_S", 0.01)
    with recipes._AT_ONCE:
        assert code_of(post(chemist, "open", name="x", recipe=packed(WATER))) == "recipe.busy"


def test_one_person_has_one_place_and_leaves_the_other_to_others(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, other = bench.people["chemist"], bench.people["approver"]
    monkeypatch.setattr(recipes, "WAIT_S", 0.01)
    with recipes._place_for(first):
        with pytest.raises(LockedError, match="of yours") as refusal, recipes._place_for(first):
            pytest.fail("a second place")
        assert refusal.value.code == "recipe.busy"
        with recipes._place_for(other):
            pass
    with recipes._place_for(first):
        pass


def test_a_recipe_that_takes_too_long_is_given_up(
    chemist: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recipes, "MOST_S", 0.01)
    answer = post(chemist, "open", name="x", recipe=packed(WATER))
    assert code_of(answer) == "recipe.too_much"


def test_an_answer_that_a_small_request_blows_up_is_refused_by_its_own_process(
    chemist: Client,
) -> None:
    """Each of many components may be each of many flasks: 50 KB ask for more than 30 MB."""
    flasks = [{"id": f"flask_{i}", "class": "ChemputerFlask", "type": "flask"} for i in range(4000)]
    graph = gzip.compress(json.dumps({"nodes": flasks, "links": []}).encode())
    parts = "".join(f'<Component id="r{i}" type="flask"/>' for i in range(700))
    recipe = (
        f"<XDL><Synthesis><Hardware>{parts}</Hardware><Reagents/><Procedure/></Synthesis></XDL>"
    )
    answer = post(chemist, "open", name="x", recipe=packed(recipe.encode()), graph=packed(graph))
    assert (answer.status_code, code_of(answer)) == (422, "recipe.too_much")


def test_no_transaction_is_open_while_a_recipe_is_read_to_be_kept(
    bench: Bench, chemist: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    depths: list[int] = []
    run = recipes._run

    def watched(act: str, asked: PreviewAsked, actor: User) -> dict[str, Any]:
        depths.append(len(connection.savepoint_ids))
        return run(act, asked, actor)

    monkeypatch.setattr(recipes, "_run", watched)
    before = len(connection.savepoint_ids)
    keys = {"Water": "water", "reactor": "reactor_1"}
    post(chemist, "keep", name="Warm", recipe=packed(WATER), bind=keys)
    assert depths == [before]


def test_a_long_file_name_leaves_the_digest_whole(bench: Bench, chemist: Client) -> None:
    keys = {"Water": "water", "reactor": "reactor_1"}
    answer = post(
        chemist, "keep", name="Warm", recipe=packed(WATER), file="w" * 900 + ".xdl", bind=keys
    )
    version = WorkflowVersion.objects.get(pk=json.loads(answer.content)["version"]["id"])
    assert version.note.endswith(hashlib.sha256(WATER).hexdigest())


def test_the_process_has_less_of_the_processor_than_the_server_waits() -> None:
    assert recipes.MOST_S > process.MAX_CPU_S
