"""Render runs, jobs and requests as the browser reads them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from datetime import datetime
from types import MappingProxyType
from typing import Any
from uuid import UUID

import msgspec

from labweb.accounts import selectors as account_selectors
from labweb.accounts.selectors import User
from labweb.approvals import selectors as approval_selectors
from labweb.approvals.selectors import ApprovalRequest
from labweb.common.prepared import together
from labweb.common.render import iso
from labweb.domain.approvals.policy import check_decision
from labweb.domain.approvals.roles import Permission
from labweb.domain.runs.context import without_surroundings
from labweb.domain.runs.custody import CustodyState
from labweb.domain.runs.departing import departures
from labweb.domain.runs.halting import is_halt_certain
from labweb.domain.runs.job import AT_EDGE, FINAL, JobState, RunState
from labweb.domain.runs.session import SessionState
from labweb.resources import selectors as resource_selectors
from labweb.resources.selectors import Lab
from labweb.runs import selectors
from labweb.runs.api.halts import render_halts
from labweb.runs.api.holds import render_holds, render_wait
from labweb.runs.api.pace import estimate_s, left_s, on_the_wall, planned_s, whole_s
from labweb.runs.api.question import render_question
from labweb.runs.api.silence import render_silent
from labweb.runs.models import Attempt, Job, Run
from labweb.telemetry import selectors as telemetry_selectors

_ENDED = {RunState.COMPLETE.value, RunState.ABORTED.value}


def names_of(lab: Lab) -> dict[str, str]:
    """Return name by id of every resource of a lab."""
    return {str(row.id): row.name for row in resource_selectors.resources_of(lab)}


def render_rows(runs: Iterable[Run]) -> list[dict[str, Any]]:
    """Render runs for a list; three queries."""
    rows = list(runs)
    holds = render_holds(rows)
    jobs: dict[UUID, list[Job]] = {}
    found = Job.objects.filter(run__in=[row.id for row in rows]).select_related("device__host")
    for job in found.order_by("index"):
        jobs.setdefault(job.run_id, []).append(job)
    return [_row(row, jobs.get(row.id, []), holds.get(row.id, [])) for row in rows]


def _row(run: Run, jobs: list[Job], holds: list[dict[str, Any]]) -> dict[str, Any]:
    steps = run.plan["steps"]
    left = [job for job in jobs if JobState(job.state) not in FINAL]
    present = [job for job in jobs if job.passed_by != "change"]
    # What depends on amounts that a person states during the run may have no jobs yet.
    begun = {job.step_id for job in present}
    undone = {job.step_id for job in present if job.state != JobState.COMPLETE.value}
    done = [step for step in steps if step["step_id"] in begun - undone]
    current = next((job for job in left if job.state != JobState.QUEUED.value), None)
    version = run.version
    ended = run.state in _ENDED
    return {
        "id": str(run.id),
        "number": run.number,
        "workflow": {
            "id": str(version.workflow_id),
            "name": version.workflow.name,
            "version": version.number,
        },
        "mode": run.lab.mode,
        "state": run.state,
        "created_by": run.created_by.printed_name,
        "created_at": iso(run.created_at),
        "started_at": iso(run.started_at),
        "ended_at": iso(run.ended_at),
        "steps_total": len(steps),
        "steps_done": len(done),
        "step_now": None if current is None else current.sentence,
        "in_doubt_count": sum(job.state == JobState.IN_DOUBT.value for job in jobs),
        "estimate_s": whole_s(jobs),
        "left_s": None if ended else left_s(left),
        "pause_reasons": run.pause_reasons,
        "waits_for": render_wait(run),
        "holds": holds,
        "recoveries": run.recoveries,
        "is_given_up": run.is_given_up,
    }


def render_plan(run: Run, jobs: Iterable[Job]) -> dict[str, Any]:
    """Render the plan a run carries out; its estimates are by the clock on the wall."""
    rows = list(jobs)
    names = {str(job.device_id): job.device.name for job in rows}
    return on_the_wall(plan_json(run.plan, run.plan_digest, names), rows)


def plan_json(plan: Mapping[str, Any], digest: str, names: Mapping[str, str]) -> dict[str, Any]:
    """Render a plan with the names of its devices."""
    jobs = [
        {
            "index": job["index"],
            "step_id": job["step_id"],
            "sentence": job["sentence"],
            "device": {
                "id": str(job["device_id"]),
                "name": names.get(str(job["device_id"]), ""),
            },
            "choices_count": len(job.get("choices") or ()),
            "action": job["action"],
            "args": job["args"],
            "after": job["after"],
            "estimate_s": job["estimate_s"],
        }
        for job in plan["jobs"]
    ]
    return {
        "digest": digest,
        "estimate_s": planned_s(jobs),
        "steps": plan["steps"],
        "jobs": jobs,
        "notes": plan["notes"],
        "proved": plan.get("proved"),
    }


def render_run(run: Run, user: User) -> dict[str, Any]:
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
    in_doubt = any(job.state == JobState.IN_DOUBT.value for job in jobs)
    names = names_of(run.lab) if in_doubt else {}
    attempts = {attempt.job_id: attempt for attempt in _attempts(run)}
    waiting = selectors.answers_under_way(attempt.id for attempt in attempts.values())
    ended = run.state in _ENDED
    asking = selectors.asking(run) if any(job.asks for job in jobs) else frozenset()
    may_run = Permission.RUN in allowed
    return {
        **_row(run, jobs, render_holds([run]).get(run.pk, [])),
        "document": run.version.document,
        "plan": render_plan(run, jobs),
        "jobs": [
            {
                **render_job(job, attempts.get(job.id), names, waiting),
                "recovery": None if ended or run.is_given_up else selectors.recovery_of(job),
                "asks": _asks(job, asking),
            }
            for job in jobs
        ],
        "given_up": _given_up(run),
        "halts": render_halts(run),
        "files": _files(jobs),
        "proof": _proof(run),
        "approval": None if request is None else {"id": str(request.id), "state": request.state},
        "execution": run.plan.get("execution"),
        "hosts_away": _hosts_away(jobs),
        "silent": render_silent(run),
        "contradicted": [
            {"ticket_id": str(one.pk), "text": one.message, "opened_at": iso(one.opened_at)}
            for one in selectors.contradicted(run, jobs)
        ],
        "can": {
            "pause": may_run
            and not ended
            and not run.is_given_up
            and not selectors.has_paused(run.pause_reasons, user),
            "recover": may_run and not ended and not run.is_given_up,
            "confirm": may_run and not ended and not run.is_given_up,
            "resume": may_run
            and not ended
            and not run.is_given_up
            and not run.lab.is_stopped
            and not any(selectors.is_unanswered(job) for job in jobs)
            and (bool(run.pause_reasons) or any(j.state == JobState.HELD.value for j in jobs)),
            "abort": may_run and not ended,
            "resolve": Permission.RESOLVE in allowed,
        },
    }


def _asks(job: Job, asking: Collection[UUID]) -> dict[str, Any] | None:
    """Say what a person confirms before a job is sent, and who has; None: nothing."""
    if not job.asks:
        return None
    by = job.confirmed_by
    return {
        "text": job.asks,
        "states": selectors.to_state(job) if job.id in asking else None,
        "is_due": job.id in asking,
        "confirmed_by": None if by is None else by.printed_name,
        "confirmed_at": iso(job.confirmed_at),
    }


def _given_up(run: Run) -> dict[str, Any] | None:
    if run.given_up is None:
        return None
    return {name: run.given_up[name] for name in ("by", "at", "reason")}


def _proof(run: Run) -> dict[str, Any] | None:
    """Say how a run of a recipe leaves what was proved, and who let it; None: it is none."""
    if run.version.proved is None:
        return None
    accepted = run.unproved or {"by": None, "at": None}
    return {
        "departures": msgspec.to_builtins(departures(run.recoveries)),
        "accepted": msgspec.to_builtins(selectors.accepted_departures(run)),
        "by": accepted["by"],
        "at": accepted["at"],
    }


def _files(jobs: list[Job]) -> list[dict[str, Any]]:
    """Return what the jobs have measured as files, whether the bytes are here or not."""
    named = {job.pk for job in jobs if (job.evidence.get("report") or {}).get("files")}
    if not named:
        return []
    return [
        {
            "id": str(row.pk),
            "job_id": str(row.job_id),
            "name": row.name,
            "format": row.format,
            "size_bytes": row.size_bytes,
            "state": row.state,
            "file_id": None if row.file_id is None else str(row.file_id),
            "code": row.code,
            "message": row.message,
        }
        for row in telemetry_selectors.measured_by(named)
    ]


def _attempts(run: Run) -> Iterable[Attempt]:
    """Return every try of a run's jobs, the newest of each last; none before it has begun."""
    if run.started_at is None:
        return ()
    rows = Attempt.objects.filter(job__run=run).select_related("transaction")
    return rows.order_by("number")


def _hosts_away(jobs: list[Job]) -> list[dict[str, Any]]:
    """Name the hosts of a run that work alone, since when, and how many jobs they have."""
    found: dict[UUID, dict[str, Any]] = {}
    for job in jobs:
        host = job.device.host
        if host.state != SessionState.ISOLATED.value or JobState(job.state) in FINAL:
            continue
        entry = {"id": str(host.id), "name": host.name, "since_at": iso(host.away_since_at)}
        known = found.setdefault(host.id, {**entry, "jobs_count": 0, "job_ids": []})
        if JobState(job.state) in AT_EDGE:
            known["jobs_count"] += 1
            known["job_ids"].append(str(job.id))
    return list(found.values())


def render_job(
    job: Job,
    attempt: Attempt | None,
    names: Mapping[str, str],
    waiting: Mapping[UUID, tuple[str, datetime]] = MappingProxyType({}),
) -> dict[str, Any]:
    """Render one job with what is known of its outcome.

    Args:
        job: Which.
        attempt: Its newest try.
        names: Of resources, by id.
        waiting: By action, who has answered what became of it, and when; the host has not heard.
    """
    answered = None if attempt is None else waiting.get(attempt.id)
    return {
        "id": str(job.id),
        "index": job.index,
        "step_id": job.step_id,
        "sentence": job.sentence,
        "device": {"id": str(job.device_id), "name": job.device.name, "key": job.device.key},
        "choices_count": len(job.choices),
        "chosen": job.chosen or None,
        "action": job.action,
        "args": job.args,
        "corrections": job.corrections,
        "operation": job.operation,
        "state": job.state,
        "state_at": iso(job.state_at),
        "started_at": iso(job.started_at),
        "ended_at": iso(job.ended_at),
        "uncertainty_s": job.uncertainty_s,
        "is_bounded": job.is_bounded,
        "estimate_s": estimate_s(job),
        "verification": job.verification,
        "code": job.code,
        "message": job.message,
        "evidence": without_surroundings(job.evidence),
        "after": job.after,
        "meets": job.meets,
        "transaction": None
        if attempt is None
        else {"id": str(attempt.transaction_id), "state": attempt.transaction.state},
        "passed_by": job.passed_by or None,
        "halted_by": job.halted_by or None,
        "is_halt_certain": is_halt_certain(job.action),
        "recovery_class": job.recovery,
        "question": render_question(job, attempt, names, answered=answered),
    }


def render_request(
    row: ApprovalRequest, run: Run, user: User, allowed: frozenset[Permission] | None = None
) -> dict[str, Any]:
    """Render a request with whether this person may answer it.

    Args:
        row: The request.
        run: What it is about, or what measured it.
        user: Who asks to see it.
        allowed: What they may do to all of the lab; None looks it up.
    """
    if allowed is None:
        allowed = resource_selectors.permissions_on_all(user, row.lab)
    code, why_not = check_decision(
        asked_by=str(row.asked_by_id),
        actor=str(user.pk),
        allow_self=row.allow_self,
        state=row.state,
    )
    may = Permission.DECIDE in allowed
    if not may and not code:
        why_not = "deciding needs the role approver on the whole lab"
    decision = getattr(row, "decision", None)
    return {
        "id": str(row.id),
        "title": row.title,
        "state": row.state,
        "about": "run" if row.calibration_id is None else "calibration",
        "run": {"id": str(run.id), "number": run.number},
        "workflow": {
            "id": str(run.version.workflow_id),
            "name": run.version.workflow.name,
            "version": run.version.number,
        },
        "policies": row.policies,
        "asked_by": {"name": row.asked_by.printed_name},
        "asked_at": iso(row.asked_at),
        "expires_at": iso(row.expires_at),
        "plan_digest": row.plan_digest,
        "can_decide": may and not code,
        "why_not": why_not or None,
        "decision": None
        if decision is None
        else {
            "is_approved": decision.is_approved,
            "printed_name": decision.printed_name,
            "meaning": decision.meaning,
            "comment": decision.comment,
            "at": iso(decision.at),
        },
    }


def render_hand_overs(run: Run) -> list[dict[str, Any]]:
    """Render, as lines of a log, how what a run carries went from host to host."""
    lines: list[dict[str, Any]] = []
    for move in selectors.moves_of_run(run):
        if move.job is None or move.origin is None or move.target is None:
            continue
        thing, first, second = move.resource.name, move.origin.name, move.target.name
        told = [("asked", move.at, f"{first} is asked to hand {thing} to {second}")]
        if move.released_at is not None:
            text = f"{thing} is released by {first}, in transit to {second}"
            told.append(("released", move.released_at, text))
        if move.ended_at is not None:
            ends = {
                move.target_id: ("received", f"{thing} is received by {second}"),
                move.origin_id: ("kept", f"{thing} is kept by {first}"),
            }
            text = f"nobody knows in whose hands {thing} is: a person takes stock of it"
            is_known = move.state == CustodyState.OWNED.value
            kind, text = ends.get(move.owner_id if is_known else None, ("lost", text))
            told.append((kind, move.ended_at, text))
        base = {"job_id": str(move.job_id), "job_index": move.job.index, "body": {}}
        lines += [{**base, "at": iso(at), "kind": kind, "text": text} for kind, at, text in told]
    return lines
