"""What a start would mean here and now: the plan, its proof, and who has to be asked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from uuid import UUID

import msgspec

from labweb.approvals import selectors as approval_selectors
from labweb.approvals import services as approval_services
from labweb.domain.crutd import operations
from labweb.domain.workflows.compile_workflow import PlannerView, compile_workflow
from labweb.domain.workflows.plan import CapableDevice, Plan, PlannedJob
from labweb.domain.workflows.plan_proof.prove_workflow import WorkflowProof, prove_plan
from labweb.domain.workflows.workflow_file import parse_workflow
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs.services.planning.lab_view import lab_view


@dataclass(frozen=True, slots=True)
class Preview:
    """What a start would mean now."""

    plan: Plan
    policies: tuple[str, ...]
    """Names of the policies that want a person to look first."""

    proof: WorkflowProof
    """What was carried out on paper, and what no proof covers."""

    def to_json(self) -> dict[str, Any]:
        """Render the plan as a run keeps it: with what was proved of it."""
        return {**msgspec.to_builtins(self.plan), "proved": self.proof.to_json()}


def preview(
    lab: Lab,
    document: dict[str, Any],
    *,
    view: PlannerView | None = None,
    reach: resource_selectors.Reach | None = None,
    rules: Sequence[approval_selectors.Policy] | None = None,
) -> Preview:
    """Compile a workflow document against the lab as it is.

    Args:
        lab: The lab.
        document: The workflow.
        view: The lab as it was read already; None reads it.
        reach: Where the asker has the permission that they need on all that the document
            names and its plan uses; None: nobody asks.
        rules: The policies that are in force; None reads them.

    Raises:
        ForbiddenError: They lack it on one of these. Told before anything is compiled where
            the document names it: findings tell what is in the vessels they speak of.
        ProtocolError: The document is malformed; findings list each place.
        PlanningError: This lab cannot do it, or its plan would not do what the document asks
            (`plan.not_proved`); findings list each reason.

    Effect:
        None.
    """
    view = view or lab_view(lab)
    if reach is not None:
        reach.require(named(view, document))
    workflow = parse_workflow(document)
    plan = compile_workflow(workflow, view)
    if reach is not None:
        reach.require(touched(plan))
    proof = prove_plan(workflow, plan, view)
    proof.require()
    names = tuple(policy.name for policy in approval_services.asking_policies(lab, plan, rules))
    return Preview(plan, names, proof)


def touched(plan: Plan) -> set[UUID]:
    """Return every resource a plan uses, on whichever device each job may be done."""
    return {node for job in plan.jobs for way in job.ways() for node in _uses(way)}


def surely_touched(plan: Plan) -> set[UUID]:
    """Return what it uses whichever device is chosen."""
    return {node for job in plan.jobs for node in set.intersection(*map(_uses, job.ways()))}


def _uses(way: PlannedJob | CapableDevice) -> set[UUID]:
    ids = set(way.locks)
    if not isinstance(way.operation, operations.Read):
        ids.update(operations.touched_ids(way.operation))
    return ids


def named(view: PlannerView, document: dict[str, Any]) -> set[UUID]:
    """Return the resources that a document names, by id or key."""
    texts = set(_texts(document))
    return {
        node.id for node in view.tree.resources if str(node.id) in texts or f"@{node.key}" in texts
    }


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value.strip().lower()
        yield value.strip()
    elif isinstance(value, dict | list):
        for child in value.values() if isinstance(value, dict) else value:
            yield from _texts(child)
