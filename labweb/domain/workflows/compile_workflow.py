"""From a workflow to the plan of one lab: what each device does, in which order, and why not."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from msgspec import UNSET

from labweb.domain.crutd.operations import Update
from labweb.domain.crutd.pre_and_postconditions import Condition
from labweb.domain.errors import Finding, InfeasibleError, ProtocolError
from labweb.domain.workflows.passes.chemistry.drying import plan_dry
from labweb.domain.workflows.passes.chemistry.evacuate_refill import plan_evacuate_refill
from labweb.domain.workflows.passes.chemistry.evaporation import plan_evaporate
from labweb.domain.workflows.passes.chemistry.filtration import plan_filter
from labweb.domain.workflows.passes.chemistry.phase_separation import plan_separate
from labweb.domain.workflows.passes.chemistry.reaction import plan_react
from labweb.domain.workflows.passes.devices.await_temperature import plan_await_temperature
from labweb.domain.workflows.passes.devices.calibration_correction import correct_step
from labweb.domain.workflows.passes.devices.camera_witness import plan_look
from labweb.domain.workflows.passes.devices.carry import plan_carry
from labweb.domain.workflows.passes.devices.device_by_role import check_whole, plan_role_action
from labweb.domain.workflows.passes.devices.heat_stir_wait_measure import PLANNERS
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob, DraftStep
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.passes.liquids.empty_syringe import plan_empty_syringe
from labweb.domain.workflows.passes.liquids.gas_push import plan_push_gas
from labweb.domain.workflows.passes.liquids.strokes import syringe_tolerance_ul
from labweb.domain.workflows.passes.liquids.transfer import plan_transfer
from labweb.domain.workflows.passes.people.person_jobs import plan_add_solid, plan_confirm
from labweb.domain.workflows.passes.plan_checks.ledger_run_through import ForecastLedger
from labweb.domain.workflows.passes.plan_checks.order_of_sharing_steps import check_order
from labweb.domain.workflows.passes.plan_checks.references import check_references
from labweb.domain.workflows.plan import CapableDevice, Plan, PlannedJob, PlannedStep
from labweb.domain.workflows.unit_operations.step_palette import sentence_text
from labweb.domain.workflows.workflow_edges import find_earlier, sort_steps
from labweb.domain.workflows.workflow_file import Step, Workflow, bind_materials

_PLANNERS = {
    "transfer": plan_transfer,
    "empty_syringe": plan_empty_syringe,
    "react": plan_react,
    "separate": plan_separate,
    "evaporate": plan_evaporate,
    "filter": plan_filter,
    "dry": plan_dry,
    "await_temperature": plan_await_temperature,
    "confirm": plan_confirm,
    "add_solid": plan_add_solid,
    "evacuate_refill": plan_evacuate_refill,
    "push_gas": plan_push_gas,
    "carry": plan_carry,
    "look": plan_look,
    "role_action": plan_role_action,
    **PLANNERS,
}

__all__ = ["PlannerView", "check_plan", "compile_workflow"]

INITIALIZE_S = 15.0
"""Estimate for finding a plunger's zero."""


def compile_workflow(workflow: Workflow, lab: PlannerView) -> Plan:
    """Plan a workflow on one state of one lab.

    Every liquid job is followed through the record, so that a plan that is returned can be
    run from this state to its end without a vessel running dry or over.

    Args:
        workflow: Parsed, with every `@key` resolved.
        lab: The lab as it is.

    Returns:
        The plan. The same workflow and lab always give the same plan.

    Raises:
        ProtocolError: The workflow itself does not say enough.
        InfeasibleError: This lab cannot do it in this state. Either carries all findings,
            each with the step's id as subject and the field in `context`.

    Effect:
        None. Nothing is reserved.
    """
    drafts, prepare, findings = _draft(workflow, lab)
    if findings:
        is_language = all(finding.code.startswith("protocol.") for finding in findings)
        error = ProtocolError if is_language else InfeasibleError
        first = findings[0]
        more = f", and {len(findings) - 1} more" if len(findings) > 1 else ""
        raise error(first.message + more, code=first.code, findings=findings)
    return _render(workflow, lab, drafts, prepare)


def check_plan(workflow: Workflow, lab: PlannerView) -> list[Finding]:
    """List everything that keeps a workflow from being planned; empty means it can be."""
    return _draft(workflow, lab)[2]


def _draft(
    workflow: Workflow, lab: PlannerView
) -> tuple[list[DraftStep], list[DraftJob], list[Finding]]:
    bound = bind_materials(workflow)
    ids = [step.id for step in bound.steps]
    order = sort_steps(ids, bound.edges)
    record = ForecastLedger(lab)
    earlier = find_earlier(ids, bound.edges)
    drafting = Drafting(view=lab, earlier=earlier, contents=record.holds, masses=record.weighs)
    if not order:
        finding = Finding("protocol.empty", "the workflow has no steps", "", {"field": "steps"})
        return [], [], [finding]
    steps = {step.id: step for step in bound.steps}
    drafts = []
    for step_id in order:
        drafts.append(_draft_step(steps[step_id], drafting))
        record.run_step(drafts[-1])
    findings = drafting.findings + check_order(drafts, drafting.earlier, lab, ids)
    findings += check_whole(drafts, workflow.execution)
    ledger = ForecastLedger(lab)
    prepare = _initialize(drafts, drafting, ledger)
    drafts = [ledger.run_step(draft) for draft in drafts]
    rank = {step_id: place for place, step_id in enumerate(order)}
    drafts = [correct_step(draft, drafting) for draft in drafts]
    findings += [f for f in drafting.findings + ledger.findings if f not in findings]
    findings = [f for f in findings if not (record.is_too_early(f) or ledger.is_too_early(f))]
    return drafts, prepare, sorted(findings, key=lambda f: rank.get(f.subject, -1))


def _draft_step(step: Step, drafting: Drafting) -> DraftStep:
    missing = check_references(step, drafting.view)
    if missing:
        drafting.findings += missing
        return DraftStep(step=step)
    return _PLANNERS[step.kind](step, drafting)


def _initialize(
    drafts: Sequence[DraftStep], drafting: Drafting, ledger: ForecastLedger
) -> list[DraftJob]:
    """Plan the zero of each pump that has none, once, before everything else."""
    jobs: list[DraftJob] = []
    seen: set[UUID] = set()
    wanted = [(draft, pump_id) for draft in drafts for pump_id in draft.pump_ids]
    for draft, pump_id in wanted:
        if pump_id in seen:
            continue
        seen.add(pump_id)
        state = drafting.view.state(pump_id)
        if state is None or state.data.get("is_initialized") is True:
            continue
        if not ledger.check_empty(pump_id, draft.step):
            continue
        device = drafting.view.device_by_node[pump_id]
        empty = Condition(
            name="pump.syringe_volume",
            device_id=device.id,
            status="volume_ul",
            low=0.0,
            high=0.0,
            tolerance=syringe_tolerance_ul(device, state.capacity_nl or 0),
        )
        job = drafting.job(
            draft.step,
            device,
            "initialize",
            {},
            sentence=f"Find the zero of {state.name}",
            operation=Update(resource_id=pump_id, data={"is_initialized": True}, needs_empty=True),
            post=(empty,),
            locks=(pump_id,),
            estimate_s=INITIALIZE_S,
        )
        jobs += [job] if job is not None else []
    return jobs


def _render(
    workflow: Workflow, lab: PlannerView, drafts: Sequence[DraftStep], prepare: Sequence[DraftJob]
) -> Plan:
    jobs = [_planned(job, index, ()) for index, job in enumerate(prepare)]
    zeroed = {job.device.id: index for index, job in enumerate(prepare)}
    last: dict[str, set[int]] = {}
    for draft in drafts:
        sources = [edge.source for edge in workflow.edges if edge.target == draft.step.id]
        before = {index for source in sources for index in last[source]}
        before |= {zeroed[job.device.id] for job in draft.jobs if job.device.id in zeroed}
        is_met = False
        for job in draft.jobs:
            index = len(jobs)
            if is_met:
                jobs.append(_planned(job, index, jobs[-1].after, meets=index - 1))
                before, is_met = {index - 1, index}, False
            else:
                is_met = job.meets_next
                meets = index + 1 if is_met else None
                jobs.append(_planned(job, index, tuple(sorted(before)), meets=meets))
                before = {index}
        last[draft.step.id] = before
    steps = [_planned_step(draft, lab, jobs) for draft in drafts]
    notes = dict.fromkeys(note for draft in drafts for note in draft.notes)
    return Plan(
        steps=tuple(steps), jobs=tuple(jobs), notes=tuple(notes), execution=workflow.execution
    )


def _planned(
    job: DraftJob, index: int, after: tuple[int, ...], *, meets: int | None = None
) -> PlannedJob:
    return PlannedJob(
        index=index,
        step_id=job.step_id,
        sentence=job.sentence,
        device_id=job.device.id,
        action=job.action,
        args=dict(job.args),
        operation=job.operation,
        after=after,
        pre=job.pre,
        post=job.post,
        locks=tuple(sorted(job.locks)),
        estimate_s=round(job.estimate_s, 3),
        recovery=job.device.spec.action(job.action).recovery,
        corrections=job.corrections,
        choices=tuple(_choice(one) for one in job.choices) or UNSET,
        meets=UNSET if meets is None else meets,
        asks=job.asks or UNSET,
        states=job.states or UNSET,
    )


def _choice(job: DraftJob) -> CapableDevice:
    return CapableDevice(
        device_id=job.device.id,
        host_id=job.device.host_id,
        args=dict(job.args),
        operation=job.operation,
        pre=job.pre,
        post=job.post,
        locks=tuple(sorted(job.locks)),
        recovery=job.device.spec.action(job.action).recovery,
        corrections=job.corrections,
    )


def _planned_step(draft: DraftStep, lab: PlannerView, jobs: Sequence[PlannedJob]) -> PlannedStep:
    own = (job.estimate_s for job in jobs if job.step_id == draft.step.id and not job.receives)
    return PlannedStep(
        step_id=draft.step.id,
        kind=draft.step.kind,
        sentence=sentence_text(draft.step.kind, draft.step.params, lab.names),
        estimate_s=round(sum(own), 3),
    )
