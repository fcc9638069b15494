"""Render what runs keep for themselves, and what they wait for."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

from labweb.domain.runs.exclusive_use.run_holds import UseMode
from labweb.domain.runs.states.job_states import RunState
from labweb.runs.answers.run_rows import RunHoldRow, RunWait
from labweb.runs.models import Run
from labweb.runs.selectors.run_holds import holds_of

_WAITING = {RunState.QUEUED.value, RunState.RUNNING.value}
_SHARED = {UseMode.DRAW.value, UseMode.POUR.value}


def render_wait(run: Run) -> RunWait | None:
    """Name the run that this one waits for, what it holds, and until which of its steps."""
    waits = run.waits
    if waits is None or waits["run_id"] is None:
        return None
    if run.pause_reasons or run.state not in _WAITING:
        return None
    return RunWait(
        id=UUID(waits["run_id"]),
        number=waits["number"],
        resource=waits["resource"],
        until_step=waits["until_step"],
        text=waits["text"],
    )


def render_holds(runs: Iterable[Run]) -> dict[UUID, list[RunHoldRow]]:
    """Render what runs keep for themselves now, by run; one query."""
    found: dict[UUID, list[RunHoldRow]] = {}
    for row in holds_of([run.pk for run in runs]):
        found.setdefault(row.run_id, []).append(
            RunHoldRow(
                resource_id=row.resource_id,
                resource=row.resource.name,
                is_shared=row.mode in _SHARED,
                until_step=row.until_step,
            )
        )
    return found
