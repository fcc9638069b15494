"""Whether a run of a recipe still does what was proved, and may go on."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from typing import Any
from uuid import UUID

import msgspec

from labweb.accounts.selectors import User
from labweb.common.clock import now
from labweb.domain.crutd import operations
from labweb.domain.crutd.operations import TransferLiquid
from labweb.domain.errors import Finding, PreconditionError, RevisionError
from labweb.domain.recipes.agreement.contents import check_contents
from labweb.domain.recipes.agreement.keeping import departs
from labweb.domain.runs.after_failure import plan_departures
from labweb.domain.runs.after_failure.plan_departures import Departure
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.unit_operations.step_palette import called
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors
from labweb.runs.models import Job, Run
from labweb.workflows.selectors import WorkflowVersion


def check_proved(
    version: WorkflowVersion, view: PlannerView, among: Container[UUID] | None = None
) -> None:
    """Refuse a recipe whose vessels hold something else than when it was proved.

    Raises:
        PreconditionError: `recipe.other_content`; `findings` list each vessel.
    """
    findings = [] if version.proved is None else check_contents(version.proved, view, among)
    _refuse(findings)


def _refuse(findings: Sequence[Finding]) -> None:
    if findings:
        first = findings[0]
        raise PreconditionError(first.message, code=first.code, findings=findings)


def departure_of(run: Run, job: Job, detail: Mapping[str, Any]) -> dict[str, str]:
    """Return how a choice leaves what was proved, for its entry; empty: nothing was proved.

    Args:
        run: The run, its plan as it is after the choice.
        job: What ended undone.
        detail: What was chosen: `choice`, and `moved_nl` or `step_id`.
    """
    if run.version.proved is None:
        return {}
    if detail["choice"] == "skip":
        return {"departs": plan_departures.skipped(job.sentence)}
    if detail["choice"] == "change":
        return {"departs": _changed(run, str(detail["step_id"]))}
    if selectors.is_discarded(job):
        return {"departs": plan_departures.unknown(job.sentence, job.attempts.count())}
    operation = operations.from_json(job.operation)
    if detail["choice"] == "done_by_hand" and isinstance(operation, TransferLiquid):
        moved_nl = selectors.moved_nl(job) + int(detail["moved_nl"] or 0)
        asked_nl = operation.amount_nl
        told = plan_departures.by_hand(job.sentence, asked_nl=asked_nl, moved_nl=moved_nl)
        return {"departs": told} if told else {}
    return {}


def _changed(run: Run, step_id: str) -> str:
    proved = _step(run.version.document, step_id)
    made = _step(run.plan["document_now"], step_id)
    if not departs(proved, made):
        return ""
    names = resource_selectors.names_in(proved["params"].values(), made["params"].values())
    return plan_departures.changed(called(proved, names), proved["params"], made["params"], names)


def _step(document: Mapping[str, Any], step_id: str) -> dict[str, Any]:
    found: dict[str, Any] = next(step for step in document["steps"] if step["id"] == step_id)
    return found


def check_departures(run: Run, *, actor: User, seen: Sequence[Departure] | None) -> None:
    """Hold a run that left what was proved until a person says that it goes on as it is.

    Args:
        run: The run, locked.
        actor: Who resumes it.
        seen: The departures that they have seen and accept; None: they accept none.

    Raises:
        PreconditionError: `recipe.deviated`; `findings` list what nobody has accepted.
        RevisionError: `recipe.deviated_since`: there are others by now than were seen.
    """
    told = plan_departures.departures(run.recoveries)
    findings = plan_departures.check_departed(told, selectors.accepted_departures(run))
    if not findings:
        return
    if seen is None:
        message = (
            f"run #{run.number} does something else than was proved: "
            f"{'; '.join(one.message for one in findings)}. Say that it goes on as it is, without "
            "a proof, or abort it"
        )
        raise PreconditionError(message, code="recipe.deviated", findings=findings)
    if list(seen) != told:
        message = "the run has left what was proved in another way than was seen: look again"
        context = {"departures": msgspec.to_builtins(told)}
        raise RevisionError(message, code="recipe.deviated_since", context=context)
    by = {"by": actor.printed_name, "by_id": str(actor.pk), "at": now().isoformat()}
    run.unproved = {**by, "departures": msgspec.to_builtins(told)}
    run.save(update_fields=["unproved"])
