"""The runs and requests of calibrations, as `labweb.calibration` asks for them by its setting."""

from __future__ import annotations

from datetime import datetime
from typing import Any
from uuid import UUID

from labweb.accounts.selectors import User
from labweb.approvals import selectors as approval_selectors
from labweb.approvals import services as approval_services
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.resources.selectors import Lab
from labweb.runs.services.execution import host_batches
from labweb.runs.services.planning.lab_view import lab_view
from labweb.runs.services.planning.start import start_run
from labweb.workflows import services as workflow_services


def view_of_lab(lab: Lab) -> PlannerView:
    """Return the frozen picture of a lab on which a measuring workflow is drawn."""
    return lab_view(lab)


def start_measurement(lab: Lab, document: dict[str, Any], *, actor: User) -> UUID:
    """Keep a drawn workflow, start it in the actor's name, and return its run.

    Raises:
        LabError: As `start_run`: the lab cannot carry it out, or the actor may not.

    Effect:
        As the workflow says, as soon as the dispatcher sends its first job.
    """
    drawn = workflow_services.create_workflow(
        lab, name=document["name"], document=document, actor=actor
    )
    version = workflow_services.save_version(drawn.id, note="calibration", actor=actor)
    return start_run(version, actor=actor).id


def recall_corrected(calibration_id: UUID, *, issued_by: str) -> int:
    """Ask the hosts to give back what they have not begun with a calibration's numbers.

    Returns:
        How many jobs were asked for.
    """
    return host_batches.recall_corrected(calibration_id, issued_by=issued_by)


def ask_person(  # noqa: PLR0913 - what a request says
    calibration_id: UUID,
    *,
    lab: Lab,
    title: str,
    digest: str,
    rule: str,
    asked_by: User,
    expires_at: datetime,
) -> None:
    """Put a result into the queue of what waits for a second person."""
    approval_services.open_request(
        lab=lab,
        title=title,
        calibration_id=calibration_id,
        plan_digest=digest,
        policies=[rule],
        asked_by=asked_by,
        expires_at=expires_at,
    )


def require_deciding(actor: User, lab: Lab) -> None:
    """Refuse who may not answer requests.

    Raises:
        ForbiddenError: They may not, or only in a part of the lab.
    """
    approval_services.require_deciding(actor, lab)


def decide_request(calibration_id: UUID, *, actor: User, is_approved: bool, comment: str) -> None:
    """Write a person's answer about a result.

    Raises:
        LabError: As `approval_services.decide`; NotFoundError where nobody was asked.
    """
    request = approval_selectors.about_calibration(calibration_id)
    approval_services.decide(request.id, actor=actor, is_approved=is_approved, comment=comment)


def request_id_of(calibration_id: UUID) -> UUID:
    """Return the request about a result.

    Raises:
        NotFoundError: Nobody was asked about it.
    """
    return approval_selectors.about_calibration(calibration_id).id
