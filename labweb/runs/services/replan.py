"""Plan what is left of a run again, with other values for one step."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import msgspec

from labweb.accounts.selectors import User
from labweb.domain.approvals.roles import Permission
from labweb.domain.errors import DefinitionError, StateError
from labweb.domain.runs.job import AT_EDGE, FINAL, JobState, Mover
from labweb.domain.workflows import plan as plans
from labweb.domain.workflows.plan import Plan
from labweb.resources import selectors as resource_selectors
from labweb.runs.models import Job, Run
from labweb.runs.services.holding import declare
from labweb.runs.services.previewing import preview
from labweb.runs.services.start import write_jobs
from labweb.runs.services.state import move_job

_UNDER_WAY = {state.value for state in AT_EDGE} | {JobState.IN_DOUBT.value}


def change_step(
    run: Run,
    job: Job,
    params: Mapping[str, Any],
    *,
    actor: User,
    state: JobState = JobState.HELD,
    approved: Collection[str] = (),
) -> dict[str, Any]:
    """Give the step of a job other values and plan all that is left of the run again.

    The jobs that were left keep their rows, passed over; new ones take their place.

    Args:
        run: The run, locked.
        job: A job of the step.
        params: The values of the step that change, or that it did not have.
        actor: Who changes them.
        state: What the new jobs are in: held until the run is resumed, or queued.
        approved: Policies for which a person has approved the run as it was with these values
            still to come.

    Returns:
        The step, its values before and after, and the digests of both plans.

    Raises:
        DefinitionError: No value is given.
        StateError: Something of the run is under way, a step is half done, or a policy wants
            a person to approve the new plan. Nothing was written.
        ProtocolError, PlanningError: The values cannot be planned; findings list each reason.
        ForbiddenError: The actor may not run things on some resource of the new plan.
    """
    if not params:
        raise DefinitionError("say which values change", code="run.no_change")
    jobs = list(Job.objects.filter(run=run).order_by("index"))
    left = _steps_left(jobs)
    document, before = _document_left(run, left, job.step_id, params)
    reach = resource_selectors.reach_of(actor, Permission.RUN)
    found = preview(run.lab, document, reach=reach)
    if asking := sorted(set(found.policies) - set(approved)):
        names = ", ".join(asking)
        text = f"{names} wants a person to approve this: start it as a run of its own"
        raise StateError(text, code="run.needs_approval")
    for old in jobs:
        if old.step_id in left and not old.passed_by:
            _pass_over(old)
    old_digest = run.plan_digest
    made = _shifted(found.plan, len(jobs))
    write_jobs(run, made, state)
    _keep_plan(run, made, found.proof.to_json(), document)
    return {
        "step_id": job.step_id,
        "before": before,
        "params": dict(params),
        "plan_before": old_digest,
        "plan_after": run.plan_digest,
    }


def _steps_left(jobs: list[Job]) -> set[str]:
    for job in jobs:
        if job.state in _UNDER_WAY:
            raise StateError(f"{job.sentence!r} is under way: wait for it", code="run.under_way")
    # The zero of a pump is looked for once, before all steps, and is no half of any.
    done = {
        job.step_id
        for job in jobs
        if job.state == JobState.COMPLETE.value and job.action != "initialize"
    }
    left = {
        job.step_id for job in jobs if job.state != JobState.COMPLETE.value and not job.passed_by
    }
    if left & done:
        text = "a step is half done: it cannot be planned again"
        raise StateError(text, code="run.step_under_way")
    return left


def _document_left(
    run: Run, left: set[str], step_id: str, params: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the steps that are left as a document, and the step's values before."""
    whole = run.plan.get("document_now") or run.version.document
    steps, before = [], {}
    for step in whole["steps"]:
        if step["id"] == step_id:
            before = {name: step["params"].get(name) for name in params}
            steps.append({**step, "params": {**step["params"], **params}})
        elif step["id"] in left:
            steps.append(step)
    edges = [edge for edge in whole["edges"] if edge["source"] in left and edge["target"] in left]
    return {**whole, "steps": steps, "edges": edges}, before


def _pass_over(job: Job) -> None:
    if JobState(job.state) in FINAL:
        job.passed_by = "change"
        job.save(update_fields=["passed_by"])
    else:
        move_job(job, JobState.STOPPED, Mover.SERVER, code="run.replanned", passed_by="change")


def _shifted(plan: Plan, by: int) -> Plan:
    jobs = tuple(
        msgspec.structs.replace(
            job,
            index=job.index + by,
            after=tuple(index + by for index in job.after),
            meets=job.meets + by if isinstance(job.meets, int) else msgspec.UNSET,
        )
        for job in plan.jobs
    )
    return msgspec.structs.replace(plan, jobs=jobs)


def _keep_plan(
    run: Run, made: Plan, proved: Mapping[str, Any], document: Mapping[str, Any]
) -> None:
    """Put the new steps, and what is proved of them, in the place of those that were left."""
    plain = msgspec.to_builtins(made)
    fresh = {step["step_id"]: step for step in plain["steps"]}
    before = run.plan.get("proved") or {"steps": [], "beyond": []}
    kept = [one for one in before["steps"] if one not in fresh]
    beyond = [one for one in before["beyond"] if one["step_id"] not in fresh]
    steps = [fresh.get(step["step_id"], step) for step in run.plan["steps"]]
    run.plan = {
        **run.plan,
        "steps": steps,
        "jobs": [*run.plan["jobs"], *plain["jobs"]],
        "document_now": dict(document),
        "proved": {
            "steps": [*kept, *proved["steps"]],
            "beyond": [*beyond, *proved["beyond"]],
        },
    }
    run.plan_digest = plans.digest(made)
    run.save(update_fields=["plan", "plan_digest"])
    declare(run)
