"""What a calibration needs of the floors above it: a run that measures, a person who decides."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Protocol, cast
from uuid import UUID

from labweb.accounts.selectors import User
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.resources.selectors import Lab
from labweb.wiring import wired


class CalibrationRuns(Protocol):
    """The runs and requests of calibrations; the setting `CALIBRATION_RUNS` names them."""

    def view_of_lab(self, lab: Lab) -> PlannerView:
        """Return the frozen picture of a lab on which a measuring workflow is drawn."""

    def start_measurement(self, lab: Lab, document: dict[str, Any], *, actor: User) -> UUID:
        """Keep a drawn workflow, start it in the actor's name, and return its run."""

    def recall_corrected(self, calibration_id: UUID, *, issued_by: str) -> int:
        """Ask the hosts to give back what they have not begun with a calibration's numbers."""

    def ask_person(  # noqa: PLR0913 - what a request says
        self,
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

    def require_deciding(self, actor: User, lab: Lab) -> None:
        """Refuse who may not answer requests; raises ForbiddenError."""

    def decide_request(
        self, calibration_id: UUID, *, actor: User, is_approved: bool, comment: str
    ) -> None:
        """Write a person's answer about a result; raises as `approvals.services.decide`."""

    def request_id_of(self, calibration_id: UUID) -> UUID:
        """Return the request about a result; raises NotFoundError."""


def calibration_runs() -> CalibrationRuns:
    """Return the runs and requests of calibrations."""
    return cast(CalibrationRuns, wired("CALIBRATION_RUNS"))
