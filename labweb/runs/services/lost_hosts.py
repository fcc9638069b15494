"""What becomes of the jobs of a host that cannot be trusted, or is lost."""

from __future__ import annotations

from labweb.common.clock import now
from labweb.crutd import services as crutd_services
from labweb.crutd.services import Settlement
from labweb.domain.crutd.settlement import Outcome, OutcomeKind
from labweb.domain.runs.host_link.host_session import FENCED_CODE, SessionState
from labweb.domain.runs.states.job_states import JobState, Mover
from labweb.enrollment.selectors import EdgeHost
from labweb.runs import selectors
from labweb.runs.models import Outbox
from labweb.runs.services.execution.custody import lose_moves_of
from labweb.runs.services.execution.job_states import move_job, refresh_run
from labweb.runs.services.stopping.abort import note_journal_gone

_WHY = {
    SessionState.FENCED.value: (FENCED_CODE, "was declared lost"),
    SessionState.REVOKED.value: ("host.revoked", "was revoked"),
}


def put_in_doubt(host: EdgeHost) -> None:
    """Put every dispatched job of a fenced host in doubt: its log can tell nothing of them."""
    left = Outbox.objects.filter(host=host, settled_at__isnull=True).exclude(kind="halt")
    left.update(settled_at=now())
    note_journal_gone(host, is_lost=host.state in _WHY)
    code, state = _WHY.get(host.state, ("host.quarantined", "is quarantined"))
    lose_moves_of(host)
    for job in selectors.jobs_at(host):
        attempt = selectors.last_attempt(job)
        if attempt is None:
            continue
        unknown = Settlement(outcome=Outcome(kind=OutcomeKind.UNKNOWN), code=code)
        crutd_services.settle(attempt.transaction_id, unknown)
        move_job(
            job,
            JobState.IN_DOUBT,
            Mover.FENCE,
            code=code,
            message=f"{host.name} {state}: nobody knows what became of this",
        )
        refresh_run(job.run_id)
