"""A workflow of a recipe, its proof, and what its runs may do with it."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import pytest
from django.test import Client

from labweb.approvals.models import ApprovalRequest, Decision
from labweb.domain.errors import PreconditionError
from labweb.runs.models import Run
from labweb.runs.services import decide_request, pause_run, resume_run, start_run
from labweb.workflows.models import Workflow, WorkflowVersion
from labweb.workflows.services import save_draft, save_version
from tests.builders import Bench, an_edge, to_transfer
from tests.domain.recipes.test_opening import WATER
from tests.labweb.crutd.hand import delivery, done
from tests.labweb.web import call, code_of
from tests.labweb.workflows.asking import kept, packed, post


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


RINSING = (
    WATER.replace(b'name="Water"', b'name="Water" use_for_cleaning="true"')
    .replace(b"<Procedure>", b'<Procedure><Add vessel="reactor" reagent="acid" volume="1 mL"/>')
    .replace(b"</Reagents>", b'<Reagent name="acid"/></Reagents>')
)
RINSING_KEYS = {"Water": "water", "acid": "acid", "reactor": "reactor_1"}


def test_a_recipe_that_rinses_is_kept_with_its_rinses_and_starts(
    bench: Bench, chemist: Client
) -> None:
    answer = post(chemist, "keep", name="Warm", recipe=packed(RINSING), bind=RINSING_KEYS)
    assert answer.status_code == 201, answer.content
    version = WorkflowVersion.objects.get(pk=json.loads(answer.content)["version"]["id"])
    steps = {step["id"]: step["params"] for step in version.document["steps"]}
    assert steps["rinse1"] == {
        "source": str(bench.node("water").id),
        "target": str(bench.node("waste").id),
        "volume": "3 mL",
        "pump": str(bench.node("pump_1").id),
    }
    run = start_run(version, actor=bench.people["chemist"])
    into_waste = [
        job for job in run.jobs.all() if job.operation.get("target_id") == steps["rinse1"]["target"]
    ]
    assert sum(job.operation["amount_nl"] for job in into_waste) == 3_000_000


def test_what_the_run_would_do_otherwise_than_is_proved_is_not_kept(
    bench: Bench, chemist: Client
) -> None:
    before = Workflow.objects.count()
    recipe = WATER.replace(b"<Procedure>", b'<Procedure><Wait time="5 min" queue="apart"/>')
    recipe = recipe.replace(b"<Add ", b'<Add queue="here" ')
    keys = {"Water": "water", "reactor": "reactor_1"}
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
    moved = saved(with_step(version.document, position={"x": 7.0, "y": 9.0}, note="here"))
    assert (moved.number, moved.proved) == (2, version.proved)
    more = {**version.document["steps"][0]["params"], "volume": "4 mL"}
    other = saved(with_step(version.document, params=more))
    assert (other.number, other.proved) == (3, None)
    again = saved(version.document)
    assert (again.number, again.proved) == (4, version.proved)


def with_step(document: dict[str, Any], **changed: object) -> dict[str, Any]:
    first, *others = document["steps"]
    return {**document, "steps": [{**first, **changed}, *others]}


def checked(client: Client, version: WorkflowVersion, document: dict[str, Any]) -> dict[str, Any]:
    body = {"document": document, "workflow_id": str(version.workflow_id)}
    answer = call(client, "POST", "/api/v1/workflows/check", body)
    assert answer.status_code == 200, answer.content
    found: dict[str, Any] = json.loads(answer.content)["proof"]
    return found


def test_a_check_says_whether_a_draft_has_the_proof_and_what_took_it_away(
    bench: Bench, chemist: Client
) -> None:
    version = kept(chemist)
    document = version.document
    assert checked(chemist, version, document) == {"version": 1, "changes": []}
    moved = with_step(document, position={"x": 7.0, "y": 9.0})
    assert checked(chemist, version, moved) == {"version": 1, "changes": []}
    more = {**document["steps"][0]["params"], "volume": "4 mL"}
    (lost,) = checked(chemist, version, with_step(document, params=more))["changes"]
    assert (lost["code"], lost["subject"]) == ("recipe.proof_lost", document["steps"][0]["id"])
    assert "volume of 'Transfer " in lost["message"]
    assert document["steps"][0]["id"] not in lost["message"].split()
    assert bench.node("water").name in lost["message"], "not its id"
    assert checked(chemist, version, {"steps": "none"})["changes"]


def test_a_check_of_what_was_drawn_speaks_of_no_proof(bench: Bench, chemist: Client) -> None:
    row = Workflow.objects.exclude(versions__proved__isnull=False).first()
    assert row is not None
    body = {"document": row.draft, "workflow_id": str(row.pk)}
    answer = call(chemist, "POST", "/api/v1/workflows/check", body)
    assert json.loads(answer.content)["proof"] is None
