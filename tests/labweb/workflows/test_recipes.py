"""Recipes over REST: opened on the lab or on a graph, advised on, kept as a workflow."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from threading import BoundedSemaphore
from typing import Any

import pytest
from django.db import connection
from django.http import HttpResponse
from django.test import Client

from labweb.approvals.models import ApprovalRequest, Decision
from labweb.common.recipes import __main__ as process
from labweb.domain.errors import PreconditionError
from labweb.domain.workflows.opening import Asked
from labweb.runs.models import Run
from labweb.runs.services import decide_request, pause_run, resume_run, start_run
from labweb.workflows.models import Workflow, WorkflowVersion
from labweb.workflows.services import recipes, save_draft, save_version
from tests.builders import Bench, an_edge, to_transfer
from tests.domain.workflows.xdl.test_opening import RECIPE, ROW, WATER, without
from tests.labweb.crutd.hand import delivery, done
from tests.labweb.web import call, code_of, signed_in

API = "/api/v1/recipes"


def packed(raw: bytes) -> str:
    return base64.b64encode(raw).decode()


@pytest.fixture
def chemist(bench: Bench) -> Client:
    return signed_in(bench.people["chemist"])


def post(client: Client, act: str, **body: object) -> HttpResponse:
    return call(client, "POST", f"{API}/{act}", body)


def opened(client: Client, **body: object) -> dict[str, Any]:
    answer = post(client, "open", **body)
    assert answer.status_code == 200, answer.content[:500]
    found: dict[str, Any] = json.loads(answer.content)
    return found


def test_a_recipe_is_planned_on_the_lab_as_it_is_and_nothing_is_stored(
    bench: Bench, chemist: Client
) -> None:
    answer = opened(chemist, name="warm", recipe=packed(WATER))
    assert answer["is_proved"] is True
    assert answer["plan"]["bindings"]["vessels"] == {"reactor": "reactor_1"}
    keys = {node["key"] for node in answer["rig"]["nodes"]}
    assert {"water", "valve_1", "pump_1"} <= keys
    assert not Workflow.objects.filter(is_template=False).exists()


def test_another_graph_gives_another_plan(chemist: Client) -> None:
    answer = opened(chemist, name="acetylation", recipe=packed(RECIPE), graph=packed(ROW))
    assert answer["is_proved"] is True
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


def test_what_a_workflow_cannot_say_is_refused_whole(bench: Bench, chemist: Client) -> None:
    before = Workflow.objects.count()
    answer = post(chemist, "keep", name="Ester", recipe=packed(RECIPE))
    found = json.loads(answer.content)
    assert answer.status_code == 422
    assert {f["code"] for f in found["findings"]} >= {"xdl.not_in_workflow"}
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

    def watched(act: str, asked: Asked) -> dict[str, Any]:
        depths.append(len(connection.savepoint_ids))
        return run(act, asked)

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


def kept(chemist: Client, recipe: bytes = WATER) -> WorkflowVersion:
    keys = {"Water": "water", "reactor": "reactor_1"}
    answer = post(chemist, "keep", name="Warm", recipe=packed(recipe), bind=keys)
    return WorkflowVersion.objects.get(pk=json.loads(answer.content)["version"]["id"])


def test_a_version_of_a_recipe_keeps_what_its_proof_takes_for_granted(
    bench: Bench, chemist: Client
) -> None:
    version = kept(chemist)
    assert version.proved is not None
    assert version.proved["recipe_sha256"] == hashlib.sha256(WATER).hexdigest()
    source = version.proved["sources"][str(bench.node("water").id)]
    assert source == {"reagent": "Water", "materials": ["water"]}
    assert start_run(version, actor=bench.people["chemist"]).version_id == version.pk


def test_a_recipe_does_not_start_once_its_flask_holds_something_else(
    bench: Bench, chemist: Client
) -> None:
    version = kept(chemist)
    source = {"reagent": "Water", "materials": ["acid"]}
    other = {**(version.proved or {}), "sources": {str(bench.node("water").id): source}}
    row = WorkflowVersion.objects.create(
        workflow=version.workflow,
        number=2,
        document=version.document,
        digest=version.digest,
        proved=other,
        at=version.at,
    )
    with pytest.raises(PreconditionError) as refusal:
        start_run(row, actor=bench.people["chemist"])
    assert [one.code for one in refusal.value.findings] == ["recipe.other_content"]


def test_what_the_run_would_do_otherwise_than_is_proved_is_not_kept(
    bench: Bench, chemist: Client
) -> None:
    before = Workflow.objects.count()
    recipe = (
        WATER.replace(b'name="Water"', b'name="Water" use_for_cleaning="true"')
        .replace(b"<Procedure>", b'<Procedure><Add vessel="reactor" reagent="acid" volume="1 mL"/>')
        .replace(b"</Reagents>", b'<Reagent name="acid"/></Reagents>')
    )
    keys = {"Water": "water", "acid": "acid", "reactor": "reactor_1"}
    answer = post(chemist, "keep", name="Warm", recipe=packed(recipe), bind=keys)
    assert (answer.status_code, code_of(answer)) == (422, "recipe.differs")
    assert Workflow.objects.count() == before


@pytest.mark.parametrize("key", ["water", "reactor_1"])
def test_a_recipe_does_not_start_once_something_was_put_into_one_of_its_vessels(
    bench: Bench, chemist: Client, key: str
) -> None:
    version = kept(chemist)
    done(bench, delivery(bench, to=key))
    with pytest.raises(PreconditionError) as refusal:
        start_run(version, actor=bench.people["chemist"])
    (found,) = refusal.value.findings
    assert (found.code, found.context["resource_id"]) == (
        "recipe.other_content",
        str(bench.node(key).id),
    )
    assert not Run.objects.exists()


def test_an_approval_is_refused_once_a_vessel_of_the_recipe_holds_something_else(
    bench: Bench, chemist: Client
) -> None:
    version = kept(chemist, WATER.replace(b'temp="40', b'temp="60'))
    run = start_run(version, actor=bench.people["chemist"])
    done(bench, delivery(bench, to="water"))
    request, approver = ApprovalRequest.objects.get(), bench.people["approver"]
    with pytest.raises(PreconditionError) as refusal:
        decide_request(request.id, actor=approver, is_approved=True, comment="")
    assert [one.code for one in refusal.value.findings] == ["recipe.other_content"]
    request.refresh_from_db()
    run.refresh_from_db()
    assert (request.state, run.state) == ("open", "awaiting_approval")
    assert not Decision.objects.exists()
    assert set(run.jobs.values_list("state", flat=True)) == {"awaiting_approval"}
    decide_request(request.id, actor=approver, is_approved=False, comment="")
    run.refresh_from_db()
    assert run.state == "aborted"


def test_a_run_does_not_go_on_with_a_vessel_that_was_changed_before_its_turn(
    bench: Bench, chemist: Client
) -> None:
    person = bench.people["chemist"]
    run = start_run(kept(chemist), actor=person)
    pause_run(run.id, actor=person)
    done(bench, delivery(bench, to="reactor_1"))
    with pytest.raises(PreconditionError) as refusal:
        resume_run(run.id, actor=person)
    assert refusal.value.code == "recipe.other_content"
    run.refresh_from_db()
    assert run.pause_reasons


def test_what_a_run_has_poured_itself_does_not_keep_it_from_going_on(
    bench: Bench, chemist: Client
) -> None:
    person, edge = bench.people["chemist"], an_edge(bench)
    run = start_run(kept(chemist), actor=person)
    while not bench.node("reactor_1").holdings.filter(amount_nl__gt=0).exists():
        edge.complete(to_transfer(run, edge))
    pause_run(run.id, actor=person)
    assert resume_run(run.id, actor=person).pause_reasons == []


def test_a_recipe_that_is_saved_again_as_it_was_proved_keeps_its_proof(
    bench: Bench, chemist: Client
) -> None:
    version, person = kept(chemist), bench.people["chemist"]
    row = version.workflow

    def saved(document: dict[str, Any]) -> WorkflowVersion:
        row.refresh_from_db()
        save_draft(row.id, document=document, revision=row.draft_revision, actor=person)
        return save_version(row.id, note="", actor=person)

    assert saved(version.document).pk == version.pk
    other = saved({**version.document, "name": "Warmer"})
    assert (other.number, other.proved) == (2, None)
    again = saved(version.document)
    assert (again.number, again.proved) == (3, version.proved)
