"""What fails in the server's own loop stays the failure of one run, one command or one duty."""

from __future__ import annotations

import logging
from functools import partial
from uuid import UUID

from django.db.transaction import atomic, on_commit
from django.db.utils import InterfaceError, OperationalError

from labweb.common.clock import now
from labweb.crutd import selectors as crutd_selectors
from labweb.crutd import services as crutd_services
from labweb.domain.runs.states.job_states import RunState
from labweb.resources import selectors as resource_selectors
from labweb.runs import selectors
from labweb.runs.models import Outbox
from labweb.runs.services.execution.job_states import announce, refresh_run

logger = logging.getLogger(__name__)

_AWAY_CLASSES = ("08", "53", "57P", "58")
"""No connection, no means left, going down, broken below: PostgreSQL, "Error Codes"."""

_PASSING_CLASSES = ("40", "55P03")
"""Two who were in each other's way, or a lock that was not free in time."""

_LONGEST_TEXT = 2000


def is_away(error: BaseException) -> bool:
    """Tell whether the database is away, which is no fault of what was asked of it.

    Django says the same of a deadlock or a statement that took too long: the state tells.
    """
    if not isinstance(error, OperationalError | InterfaceError):
        return False
    state = _state(error)
    return not state or state.startswith(_AWAY_CLASSES)


def is_passing(error: BaseException) -> bool:
    """Tell whether the same is likely to go at the next turn."""
    return _state(error).startswith(_PASSING_CLASSES)


def _state(error: BaseException) -> str:
    """Return the SQLSTATE of an error of the database; empty: it has none."""
    return str(getattr(error.__cause__, "sqlstate", None) or "")


def set_aside(run_id: UUID, error: Exception) -> None:
    """Pause a run that cannot be dispatched, and tell a person why; the others go on.

    Effect:
        None on matter: nothing of what failed was written or sent, and what was sent before goes
        on to its end. Whoever resumes the run has it tried again.
    """
    with atomic():
        run = selectors.run_for_update(run_id)
        reason = {"kind": "server error", "by": None, "at": now().isoformat()}
        run.pause_reasons = [*run.pause_reasons, reason]
        run.save(update_fields=["pause_reasons"])
        text = f"run #{run.number} is paused, for the server cannot dispatch it: {_told(error)}"
        crutd_services.open_ticket(
            run.lab, "run.not_dispatched", text[:_LONGEST_TEXT], {"run_id": str(run_id)}
        )
        try:
            with atomic():
                refresh_run(run_id)
        except Exception as unread:
            if is_away(unread):
                raise
            logger.exception("the jobs of run %s cannot be read", run_id)
            run.state = RunState.PAUSED.value
            run.save(update_fields=["state"])
            on_commit(partial(announce, run_id))
    logger.error("run %s cannot be dispatched and is paused", run_id, exc_info=error)


def doubt_command(row: Outbox, error: Exception) -> None:
    """Tell a person once of a command that cannot be sent; it is tried again with the others."""
    about = {"host_id": str(row.host_id), "action_id": str(row.action_id)}
    known = crutd_selectors.open_tickets(row.host.lab).filter(code="host.not_told")
    if known.filter(detail__contains=about).exists():
        return
    logger.error("%s of action %s cannot be sent", row.kind, row.action_id, exc_info=error)
    text = f"a command to {row.host.name}, {row.kind}, cannot be sent: {_told(error)}"
    crutd_services.open_ticket(row.host.lab, "host.not_told", text[:_LONGEST_TEXT], about)


def tell_failing(duty: str, error: Exception) -> None:
    """Tell a person once of something that the server looks after and cannot."""
    for lab in resource_selectors.labs():
        known = crutd_selectors.open_tickets(lab).filter(code="server.failing", detail__duty=duty)
        if not known.exists():
            text = f"the server fails to {duty}, and goes on with the rest: {_told(error)}"
            detail = {"duty": duty}
            crutd_services.open_ticket(lab, "server.failing", text[:_LONGEST_TEXT], detail)


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"
