"""Drafts, versions and templates."""

from __future__ import annotations

import pytest

from labweb.domain.errors import DefinitionError, ForbiddenError, ProtocolError, RevisionError
from labweb.runs import services as run_services
from labweb.workflows import services
from labweb.workflows.models import WorkflowVersion
from tests.builders import MOVE_WATER, Bench

EMPTY = {"schema": "labweb.workflow/1", "name": "Mine", "steps": [], "edges": []}


def test_a_draft_is_saved_over_the_revision_its_author_saw(bench: Bench) -> None:
    chemist = bench.people["chemist"]
    row = services.create_workflow(bench.lab, name="Mine", document=None, actor=chemist)
    services.save_draft(row.id, document=EMPTY, revision=1, actor=chemist)
    with pytest.raises(RevisionError) as refusal:
        services.save_draft(row.id, document=EMPTY, revision=1, actor=chemist)
    assert refusal.value.context["revision"] == 2


def test_the_same_draft_twice_is_one_version(bench: Bench) -> None:
    chemist = bench.people["chemist"]
    document = bench.version(MOVE_WATER).document
    row = services.create_workflow(bench.lab, name="Mine", document=document, actor=chemist)
    first = services.save_version(row.id, note="", actor=chemist)
    assert services.save_version(row.id, note="again", actor=chemist) == first
    assert WorkflowVersion.objects.filter(workflow=row).count() == 1


def test_a_malformed_draft_becomes_no_version(bench: Bench) -> None:
    chemist = bench.people["chemist"]
    soup = {"steps": [{"id": "a", "kind": "soup"}]}
    row = services.create_workflow(bench.lab, name="Mine", document=soup, actor=chemist)
    with pytest.raises(ProtocolError):
        services.save_version(row.id, note="", actor=chemist)


def test_a_version_is_of_the_draft_its_author_saw(bench: Bench) -> None:
    chemist, approver = bench.people["chemist"], bench.people["approver"]
    document = bench.version(MOVE_WATER).document
    row = services.create_workflow(bench.lab, name="Mine", document=document, actor=chemist)
    theirs = {**document, "name": "Theirs"}
    services.save_draft(row.id, document=theirs, revision=1, actor=approver)
    with pytest.raises(RevisionError) as refusal:
        services.save_version(row.id, note="", actor=chemist, revision=1)
    assert refusal.value.code == "workflow.revision"
    assert refusal.value.context == {"revision": 2, "document": theirs}
    assert not WorkflowVersion.objects.filter(workflow=row).exists()
    assert services.save_version(row.id, note="", actor=chemist, revision=2).document == theirs


@pytest.mark.parametrize("name", ["", "   ", "x" * 201])
def test_a_workflow_needs_a_name_of_bounded_length(bench: Bench, name: str) -> None:
    with pytest.raises(DefinitionError):
        services.create_workflow(bench.lab, name=name, document=None, actor=bench.people["chemist"])


@pytest.mark.parametrize("name", ["Heat\u202egnp", "Heat\x07", "Heat\nand stir", "a\x00b"])
def test_a_name_that_does_not_read_as_written_is_refused(bench: Bench, name: str) -> None:
    chemist = bench.people["chemist"]
    with pytest.raises(DefinitionError) as refusal:
        services.create_workflow(bench.lab, name=name, document=None, actor=chemist)
    assert refusal.value.code == "workflow.name"
    row = services.create_workflow(bench.lab, name="Wärme 加热 5 µL", document=None, actor=chemist)
    with pytest.raises(DefinitionError) as refusal:
        services.save_draft(row.id, document={**EMPTY, "name": name}, revision=1, actor=chemist)
    assert refusal.value.code == "workflow.name"
    row.refresh_from_db()
    assert (row.draft_revision, row.name) == (1, "Wärme 加热 5 µL")


def test_an_observer_draws_nothing(bench: Bench) -> None:
    with pytest.raises(ForbiddenError):
        services.create_workflow(
            bench.lab, name="Mine", document=None, actor=bench.people["observer"]
        )


def test_a_preview_writes_nothing_and_tells_what_asks(bench: Bench) -> None:
    found = run_services.preview(bench.lab, bench.version("Heat and stir").document)
    assert len(found.policies) == 1
    assert not bench.lab.runs.exists()
