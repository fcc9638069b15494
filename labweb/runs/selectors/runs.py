"""Reads of runs."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import NamedTuple
from uuid import UUID

from django.db.models import CharField, QuerySet, Value
from django.db.models.functions import Cast, Concat

from labweb.domain.errors import NotFoundError
from labweb.domain.runs.after_failure.recovery_choices import RunWaitCause
from labweb.domain.runs.states.job_states import RunState
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs.models import Job, Run
from labweb.runs.selectors.recovery import (
    waits_of,
)


def runs_of(lab: Lab) -> QuerySet[Run]:
    """Runs of a lab, newest first."""
    return Run.objects.filter(lab=lab).select_related("version__workflow", "created_by", "lab")


def visible_runs(lab: Lab, seen: Collection[UUID]) -> QuerySet[Run]:
    """Runs that use none but the given resources, newest first; all to who sees the root."""
    if resource_selectors.root_of(lab).id in seen:
        return runs_of(lab)
    shown = [str(node) for node in seen]
    hidden = Job.objects.filter(run__lab=lab).exclude(locks__contained_by=shown)
    return runs_of(lab).exclude(pk__in=hidden.values("run_id"))


def runs_named(rows: QuerySet[Run], text: str) -> QuerySet[Run]:
    """Return those of the runs whose name has a text, `Run #12 Move water`; in any case."""
    number = Cast("number", CharField())
    name = Concat(Value("Run #"), number, Value(" "), "version__workflow__name")
    return rows.alias(called=name).filter(called__icontains=text)


def waiting_runs(version_id: UUID) -> list[Run]:
    """Runs of a version that have not begun, newest first."""
    over = [RunState.COMPLETE.value, RunState.ABORTED.value]
    rows = Run.objects.filter(version_id=version_id, started_at=None).exclude(state__in=over)
    return list(rows.order_by("-number"))


def find_run(run_id: UUID) -> Run:
    """Return a run.

    Raises:
        NotFoundError: There is none.
    """
    row = (
        Run.objects.filter(pk=run_id)
        .select_related("version__workflow", "created_by", "lab")
        .first()
    )
    if row is None:
        raise NotFoundError(f"no run {run_id}", code="run.not_found")
    return row


def named_run(text: str) -> Run:
    """Return a run by its id, or by its number, with `#` before it or not.

    Raises:
        NotFoundError: There is none, or the text is neither.
    """
    number = text.removeprefix("#")
    if number.isascii() and number.isdigit() and len(number) < 10:
        row = runs_of(resource_selectors.the_lab()).filter(number=int(number)).first()
        if row is None:
            raise NotFoundError(f"there is no run #{number}", code="run.not_found")
        return row
    try:
        return find_run(UUID(text))
    except ValueError as error:
        what = f"{text!r} is neither the id nor the number of a run"
        raise NotFoundError(what, code="run.not_found") from error


def runs_by_id(ids: Iterable[UUID]) -> dict[UUID, Run]:
    """Return runs by id, with workflow and lab."""
    rows = Run.objects.filter(pk__in=list(ids)).select_related("version__workflow", "lab")
    return {row.id: row for row in rows}


class LastRun(NamedTuple):
    """The newest run of a workflow."""

    run: Run
    waits_for: RunWaitCause | None
    """What a person has to say before it can go on."""


def last_runs(lab: Lab) -> dict[UUID, LastRun]:
    """Return the newest run of each workflow, and what it waits for."""
    rows = list(
        Run.objects.filter(lab=lab)
        .select_related("version")
        .order_by("version__workflow_id", "-number")
        .distinct("version__workflow_id")
    )
    ended = {RunState.COMPLETE.value, RunState.ABORTED.value}
    waits = waits_of(row.id for row in rows if row.state not in ended)
    return {row.version.workflow_id: LastRun(row, waits.get(row.id)) for row in rows}
