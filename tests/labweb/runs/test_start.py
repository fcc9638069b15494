"""Starting: what runs is what the person saw."""

from __future__ import annotations

from http import HTTPStatus
from typing import Any

import pytest
from django.test import Client

from labweb.domain.errors import RevisionError
from labweb.domain.workflows import plan as plans
from labweb.runs import services
from labweb.runs.models import Run
from labweb.workflows import services as workflow_services
from tests.builders import MOVE_WATER, PASSWORD, Bench
from tests.labweb.web import Keyed

API = "/api/v1"


def posted(client: Client, path: str, body: dict[str, Any]) -> tuple[int, dict[str, Any]]:
    answer = client.post(f"{API}/{path}", body, content_type="application/json")
    return answer.status_code, answer.json()


def at_the_page(bench: Bench, username: str) -> Client:
    client = Keyed()
    person = bench.people[username].get_username()
    status, _ = posted(client, "session", {"username": person, "password": PASSWORD})
    assert status == HTTPStatus.OK
    return client


def test_the_plan_that_was_seen_is_the_one_that_starts(bench: Bench) -> None:
    version = bench.version(MOVE_WATER)
    seen = plans.digest(services.preview(bench.lab, version.document).plan)
    run = services.start_run(version, actor=bench.people["chemist"], seen_digest=seen)
    assert run.plan_digest == seen


def test_a_plan_that_nobody_saw_is_not_started(bench: Bench) -> None:
    version = bench.version(MOVE_WATER)
    other = bench.version("Heat and stir")
    seen = plans.digest(services.preview(bench.lab, other.document).plan)
    with pytest.raises(RevisionError) as refusal:
        services.start_run(version, actor=bench.people["chemist"], seen_digest=seen)
    assert refusal.value.code == "run.plan_changed"
    assert not Run.objects.exists()


def test_the_digest_of_a_check_starts_the_version_that_was_saved_of_it(bench: Bench) -> None:
    client = at_the_page(bench, "chemist")
    document = bench.version(MOVE_WATER).document
    seen = posted(client, "workflows/check", {"document": document})[1]["plan"]["digest"]
    _, made = posted(client, "workflows", {"name": document["name"], "document": document})
    path = f"workflows/{made['id']}/versions"
    _, version = posted(client, path, {"note": "", "revision": made["draft_revision"]})
    body = {"version_id": version["id"], "plan_digest": seen}
    status, run = posted(client, "runs", body)
    assert (status, run["plan"]["digest"]) == (HTTPStatus.CREATED, seen)


def test_another_draft_in_between_is_neither_saved_nor_started(bench: Bench) -> None:
    client = at_the_page(bench, "chemist")
    document = bench.version(MOVE_WATER).document
    _, made = posted(client, "workflows", {"name": "Mine", "document": document})
    seen = posted(client, "workflows/check", {"document": document})[1]["plan"]["digest"]
    theirs = bench.version("Heat and stir").document
    approver = bench.people["approver"]
    workflow_services.save_draft(made["id"], document=theirs, revision=1, actor=approver)
    path = f"workflows/{made['id']}/versions"
    status, refusal = posted(client, path, {"note": "", "revision": 1})
    assert (status, refusal["code"]) == (HTTPStatus.CONFLICT, "workflow.revision")
    _, version = posted(client, path, {"note": ""})
    body = {"version_id": version["id"], "plan_digest": seen}
    status, refusal = posted(client, "runs", body)
    assert (status, refusal["code"]) == (HTTPStatus.CONFLICT, "run.plan_changed")
    assert not Run.objects.exists()
