"""Render runs as the browser reads them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any
from uuid import UUID

import msgspec

from labweb.accounts import selectors as account_selectors
from labweb.accounts.selectors import User
from labweb.approvals import selectors as approval_selectors
from labweb.common.answers import NamedRef
from labweb.common.database.prepared_queries import together
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.graph.lab_file.lab_model import LabMode
from labweb.domain.runs.after_failure.plan_departures import departures
from labweb.domain.runs.host_link.host_session import SessionState
from labweb.domain.runs.states.job_states import AT_EDGE, FINAL, JobState, RunState
from labweb.domain.workflows.plan import Execution, PlannedStep
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs import selectors
from labweb.runs.answers.jobs import JobRow
from labweb.runs.answers.plans import PlanJob, PlanProof, PlanView
from labweb.runs.answers.run_rows import PauseReason, RunHoldRow, RunRecovery, RunRow, RunWorkflow
from labweb.runs.answers.runs import (
    ContradictedAnswer,
    HostAway,
    JobFile,
    RunApproval,
    RunDetail,
    RunGivenUp,
    RunProof,
    RunRights,
)
from labweb.runs.api.halts import render_halts
from labweb.runs.api.holds import render_holds, render_wait
from labweb.runs.api.jobs import render_asks, render_job
from labweb.runs.api.unread_devices import render_silent
from labweb.runs.api.wall_clock import left_s, on_the_wall, planned_s, whole_s
from labweb.runs.models import Attempt, Job, Run
from labweb.telemetry import selectors as telemetry_selectors
from labweb.telemetry.answers import FileState

_ENDED = {RunState.COMPLETE.value, RunState.ABORTED.value}


def names_of(lab: Lab) -> dict[str, str]:
    """Return name by id of every resource of a lab."""
    return {str(row.id): row.name for row in resource_selectors.resources_of(lab)}


def render_rows(runs: Iterable[Run]) -> list[RunRow]:
    """Render runs for a list; three queries."""
    rows = list(runs)
    holds = render_holds(rows)
    jobs: dict[UUID, list[Job]] = {}
    found = Job.objects.filter(run__in=[row.id for row in rows]).select_related("device__host")
    for job in found.order_by("index"):
        jobs.setdefault(job.run_id, []).append(job)
    return [_row(row, jobs.get(row.id, []), holds.get(row.id, [])) for row in rows]


def _row(run: Run, jobs: list[Job], holds: list[RunHoldRow]) -> RunRow:
    steps = run.plan["steps"]
    left = [job for job in jobs if JobState(job.state) not in FINAL]
    present = [job for job in jobs if job.passed_by != "change"]
    # What depends on amounts that a person states during the run may have no jobs yet.
    begun = {job.step_id for job in present}
    undone = {job.step_id for job in present if job.state != JobState.COMPLETE.value}
    done = [step for step in steps if step["step_id"] in begun - undone]
    current = next((job for job in left if job.state != JobState.QUEUED.value), None)
    version = run.version
    return RunRow(
        id=run.id,
        number=run.number,
        workflow=RunWorkflow(
            id=version.workflow_id, name=version.workflow.name, version=version.number
        ),
        mode=LabMode(run.lab.mode),
        state=RunState(run.state),
        created_by=run.created_by.printed_name,
        created_at=run.created_at,
        started_at=run.started_at,
        ended_at=run.ended_at,
        steps_total=len(steps),
        steps_done=len(done),
        step_now=None if current is None else current.sentence,
        in_doubt_count=sum(job.state == JobState.IN_DOUBT.value for job in jobs),
        estimate_s=whole_s(jobs),
        left_s=None if run.state in _ENDED else left_s(left),
        pause_reasons=msgspec.convert(run.pause_reasons, list[PauseReason]),
        waits_for=render_wait(run),
        holds=holds,
        recoveries=msgspec.convert(run.recoveries, list[RunRecovery]),
        is_given_up=run.is_given_up,
    )


def render_plan(run: Run, jobs: Iterable[Job]) -> PlanView:
    """Render the plan a run carries out; its estimates are by the clock on the wall."""
    rows = list(jobs)
    names = {str(job.device_id): job.device.name for job in rows}
    return on_the_wall(plan_view(run.plan, run.plan_digest, names), rows)


def plan_view(plan: Mapping[str, Any], digest: str, names: Mapping[str, str]) -> PlanView:
    """Render a plan with the names of its devices."""
    jobs = [
        PlanJob(
            index=job["index"],
            step_id=job["step_id"],
            sentence=job["sentence"],
            device=NamedRef(
                id=UUID(str(job["device_id"])), name=names.get(str(job["device_id"]), "")
            ),
            choices_count=len(job.get("choices") or ()),
            action=job["action"],
            args=job["args"],
            after=list(job["after"]),
            estimate_s=job["estimate_s"],
        )
        for job in plan["jobs"]
    ]
    return PlanView(
        digest=digest,
        estimate_s=planned_s(jobs),
        steps=msgspec.convert(plan["steps"], list[PlannedStep]),
        jobs=jobs,
        notes=list(plan["notes"]),
        proved=msgspec.convert(plan.get("proved"), PlanProof | None),
    )


def render_run(run: Run, user: User) -> RunDetail:
    """Render a run whole."""
    found: list[list[Any]] = together(
        selectors.JOBS_OF.asking(run=run.pk),
        approval_selectors.OF_RUN.asking(run=run.pk),
        account_selectors.ROLES.asking(user=user.pk),
    )
    jobs: list[Job] = found[0]
    for job in jobs:
        job.run = run
    request = next(iter(found[1]), None)
    allowed = resource_selectors.permissions_of(user, [role for (role,) in found[2]])
    return RunDetail(
        **msgspec.structs.asdict(_row(run, jobs, render_holds([run]).get(run.pk, []))),
        document=run.version.document,
        plan=render_plan(run, jobs),
        jobs=_jobs(run, jobs),
        given_up=_given_up(run),
        halts=render_halts(run),
        files=_files(jobs),
        proof=_proof(run),
        approval=None if request is None else RunApproval(id=request.id, state=request.state),
        execution=msgspec.convert(run.plan.get("execution"), Execution | None),
        hosts_away=_hosts_away(jobs),
        silent=render_silent(run),
        contradicted=[
            ContradictedAnswer(ticket_id=one.pk, text=one.message, opened_at=one.opened_at)
            for one in selectors.contradicted(run, jobs)
        ],
        can=_rights(run, jobs, user, allowed),
    )


def _jobs(run: Run, jobs: list[Job]) -> list[JobRow]:
    """Render the jobs of a run, each with what a person may do about it."""
    in_doubt = any(job.state == JobState.IN_DOUBT.value for job in jobs)
    names = names_of(run.lab) if in_doubt else {}
    attempts = {attempt.job_id: attempt for attempt in _attempts(run)}
    waiting = selectors.answers_under_way(attempt.id for attempt in attempts.values())
    is_over = run.state in _ENDED or run.is_given_up
    asking = selectors.asking(run) if any(job.asks for job in jobs) else frozenset()
    return [
        msgspec.structs.replace(
            render_job(job, attempts.get(job.id), names, waiting),
            recovery=None if is_over else selectors.recovery_of(job),
            asks=render_asks(job, asking),
        )
        for job in jobs
    ]


def _rights(run: Run, jobs: list[Job], user: User, allowed: Collection[Permission]) -> RunRights:
    """Say what a person may do about a run."""
    may_run, ended = Permission.RUN in allowed, run.state in _ENDED
    may_act = may_run and not ended and not run.is_given_up
    return RunRights(
        pause=may_act and not selectors.has_paused(run.pause_reasons, user),
        recover=may_act,
        confirm=may_act,
        resume=may_act
        and not run.lab.is_stopped
        and not any(selectors.is_unanswered(job) for job in jobs)
        and (bool(run.pause_reasons) or any(j.state == JobState.HELD.value for j in jobs)),
        abort=may_run and not ended,
        resolve=Permission.RESOLVE in allowed,
    )


def _given_up(run: Run) -> RunGivenUp | None:
    told = run.given_up
    return None if told is None else RunGivenUp(by=told["by"], at=told["at"], reason=told["reason"])


def _proof(run: Run) -> RunProof | None:
    """Say how a run of a recipe leaves what was proved, and who let it; None: it is none."""
    if run.version.proved is None:
        return None
    accepted = run.unproved or {"by": None, "at": None}
    return RunProof(
        departures=list(departures(run.recoveries)),
        accepted=selectors.accepted_departures(run),
        by=accepted["by"],
        at=accepted["at"],
    )


def _files(jobs: list[Job]) -> list[JobFile]:
    """Return what the jobs have measured as files, whether the bytes are here or not."""
    named = {job.pk for job in jobs if (job.evidence.get("report") or {}).get("files")}
    if not named:
        return []
    return [
        JobFile(
            id=row.pk,
            job_id=row.job_id,
            name=row.name,
            format=row.format,
            size_bytes=row.size_bytes,
            state=msgspec.convert(str(row.state), FileState),
            file_id=row.file_id,
            code=row.code,
            message=row.message,
        )
        for row in telemetry_selectors.measured_by(named)
        if row.job_id is not None
    ]


def _attempts(run: Run) -> Iterable[Attempt]:
    """Return every try of a run's jobs, the newest of each last; none before it has begun."""
    if run.started_at is None:
        return ()
    rows = Attempt.objects.filter(job__run=run).select_related("transaction")
    return rows.order_by("number")


def _hosts_away(jobs: list[Job]) -> list[HostAway]:
    """Name the hosts of a run that work alone, since when, and how many jobs they have."""
    found: dict[UUID, HostAway] = {}
    for job in jobs:
        host = job.device.host
        if host.state != SessionState.ISOLATED.value or JobState(job.state) in FINAL:
            continue
        new = HostAway(
            id=host.id, name=host.name, since_at=host.away_since_at, jobs_count=0, job_ids=[]
        )
        known = found.setdefault(host.id, new)
        if JobState(job.state) in AT_EDGE:
            known.jobs_count += 1
            known.job_ids.append(job.id)
    return list(found.values())
