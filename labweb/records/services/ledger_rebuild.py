"""Compare the whole record with its events, and write it anew from them."""

from __future__ import annotations

from django.db.transaction import atomic

from labweb.crutd import services as crutd_services
from labweb.crutd.selectors.history_replay import rebuild_differences
from labweb.domain.errors import Finding, ReconcileError
from labweb.resources.selectors import Lab
from labweb.runs.services.fault_recovery.job_states_from_events import (
    job_differences,
    write_job_states,
)


def differences(lab: Lab) -> list[Finding]:
    """List every way in which tree, ledger, transactions and jobs are not what events tell.

    Raises:
        ReconcileError: The import or an event cannot be read.
    """
    return [*rebuild_differences(lab), *job_differences(lab)]


@atomic
def rebuild(lab: Lab) -> None:
    """Write tree, lots, ledger, and the states of transactions and jobs from what events tell.

    Raises:
        ReconcileError: As `crutd.services.rebuild`, or the events of a host cannot be. Nothing
            was written.
        StateError: Something is under way.

    Effect:
        None on matter.
    """
    crutd_services.rebuild(lab)
    write_job_states(lab)
    left = differences(lab)
    if left:
        raise ReconcileError(left[0].message, code="rebuild.stray", findings=left)
