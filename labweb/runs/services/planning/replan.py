"""Plan what is left of a run again, with other values for one step."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import partial
from typing import Any

import msgspec
from django.db.transaction import on_commit

from labweb.accounts.selectors import User
from labweb.common.database.prepared_queries import together
from labweb.common.dispatcher_wakeup import wake_dispatcher
from labweb.domain.approvals.role_permissions import Permission
from labweb.domain.errors import DefinitionError, StateError
from labweb.domain.runs.after_failure.replanning import Stood, document_left, steps_left
from labweb.domain.runs.states.job_states import FINAL, JobState, Mover
from labweb.domain.workflows import plan as plans
from labweb.domain.workflows.plan import Plan
from labweb.domain.workflows.workflow_file import bind_materials, parse_workflow, render_workflow
from labweb.resources import selectors as resource_selectors
from labweb.runs.models import Job, Run
from labweb.runs.services.execution.job_states import announce, moving
from labweb.runs.services.execution.run_holds import declare
from labweb.runs.services.planning.preview import preview
from labweb.runs.services.planning.start import write_jobs


def change_step(
    run: Run,
    job: Job,
    params: Mapping[str, Any] | None,
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
        params: The values of the step that change, or that it did not have; None: the step is
            left out.
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
    if params is not None and not params:
        raise DefinitionError("say which values change", code="run.no_change")
    jobs = list(Job.objects.filter(run=run).order_by("index"))
    whole = _document_of(run)
    left = steps_left(map(_stood, jobs), whole["steps"])
    document, before = document_left(whole, left, job.step_id, params)
    told = {
        "step_id": job.step_id,
        "before": before,
        "params": None if params is None else dict(params),
        "plan_before": run.plan_digest,
    }
    passed = [one for one in jobs if one.step_id in left and _is_to_pass(one)]
    if not document["steps"]:
        _pass_over(run, passed)
        return {**told, "plan_after": run.plan_digest}
    reach = resource_selectors.reach_of(actor, Permission.RUN)
    found = preview(run.lab, document, reach=reach)
    if asking := sorted(set(found.policies) - set(approved)):
        names = ", ".join(asking)
        text = f"{names} wants a person to approve this: start it as a run of its own"
        raise StateError(text, code="run.needs_approval")
    _pass_over(run, passed)
    made = _shifted(found.plan, len(jobs))
    write_jobs(run, made, state)
    _keep_plan(run, made, found.proof.to_json(), document)
    return {**told, "plan_after": run.plan_digest}


def _document_of(run: Run) -> dict[str, Any]:
    """Return what the run does from its last plan on, each vessel named where an edge said it."""
    whole = run.plan.get("document_now") or run.version.document
    return render_workflow(bind_materials(parse_workflow(whole)))


def _stood(job: Job) -> Stood:
    return Stood(
        step_id=job.step_id,
        sentence=job.sentence,
        action=job.action,
        state=JobState(job.state),
        passed_by=job.passed_by,
        is_confirmed=job.confirmed_at is not None and not job.states,
    )


def _is_to_pass(job: Job) -> bool:
    return not job.passed_by and job.state != JobState.COMPLETE.value


def _pass_over(run: Run, jobs: Sequence[Job]) -> None:
    """Let other jobs take the place of these; one exchange, however many they are."""
    ended = [job.pk for job in jobs if JobState(job.state) in FINAL]
    Job.objects.filter(pk__in=ended).update(passed_by="change")
    stopped = [
        moving(job, JobState.STOPPED, Mover.SERVER, code="run.replanned", passed_by="change")
        for job in jobs
        if JobState(job.state) not in FINAL
    ]
    together(*stopped)
    wake_dispatcher()
    on_commit(partial(announce, run.id))


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
