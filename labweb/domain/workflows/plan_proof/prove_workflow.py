"""The plan of a workflow, carried out on paper before anything moves.

```text
workflow ─▶ what each step claims ─┐
plan     ─▶ actions of its jobs ───┼─▶ proof ─▶ findings, and what no proof covers
lab      ─▶ plumbing and contents ─┘
```

The claim of a step comes from what the person asked for, its actions from the jobs as they are
dispatched. The proof compares the two and knows nothing of how the jobs were made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from labweb.domain.errors import Finding, InfeasibleError
from labweb.domain.proof import plan_read as proved
from labweb.domain.proof.execute_plan import execute
from labweb.domain.workflows.passes.lab_view import PlannerView
from labweb.domain.workflows.plan import Plan, PlannedJob
from labweb.domain.workflows.plan_proof.lab_for_proof import capacities_of, contents_of, plumbing_of
from labweb.domain.workflows.plan_proof.step_claims import (
    NOT_PROVED,
    Beyond,
    ClaimReading,
    not_done,
)
from labweb.domain.workflows.workflow_file import Step, Workflow, bind_materials


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkflowProof:
    """What came of carrying a plan out on paper."""

    findings: tuple[Finding, ...] = ()
    """What is not as the workflow asks; none: all that is covered is proved."""

    covered: tuple[str, ...] = ()
    """Steps that move or change liquids, or move gas, and were carried out."""

    beyond: tuple[Beyond, ...] = ()
    """Steps that change matter and that no proof covers."""

    def require(self) -> None:
        """Refuse a plan of which something is not as the workflow asks.

        Raises:
            InfeasibleError: `plan.not_proved`, with all findings.
        """
        if self.findings:
            first = self.findings[0]
            raise InfeasibleError(first.message, code=first.code, findings=self.findings)

    def to_json(self) -> dict[str, Any]:
        """Render what was carried out, as plain data."""
        beyond = [{"step_id": one.step_id, "why": one.why} for one in self.beyond]
        return {"steps": list(self.covered), "beyond": beyond}


def prove_plan(workflow: Workflow, plan: Plan, lab: PlannerView) -> WorkflowProof:
    """Carry the plan of a workflow out on paper, on the lab as it is.

    Args:
        workflow: What was asked for, with every `@key` resolved.
        plan: What its jobs are, as they are dispatched.
        lab: The lab that it was planned on.

    Returns:
        Findings `plan.not_proved`, each with the id of its step as subject. A step that moves no
        matter needs no proof. What has no claim yet (`claiming`) is beyond the proof, and so is
        what touches the same vessels after it.

    Effect:
        None.
    """
    steps = {step.id: step for step in bind_materials(workflow).steps}
    jobs: dict[str, list[PlannedJob]] = {}
    for job in plan.jobs:
        jobs.setdefault(job.step_id, []).append(job)
    reading = ClaimReading(lab)
    read: list[tuple[Step, proved.ProofStep]] = []
    order = [told.step_id for told in plan.steps]
    findings = _others(steps, order, jobs, lab)
    for step in (steps[step_id] for step_id in dict.fromkeys(order) if step_id in steps):
        made = reading.step(step, jobs.get(step.id, []))
        read += [(step, made)] if made is not None else []
    # The record refuses unordered steps that share anything, so one order stands for all.
    paper = proved.ProofPlan(
        steps=tuple(
            replace(one, id=place, after=tuple(range(1, place)))
            for place, (_, one) in enumerate(read, start=1)
        ),
        contents=contents_of(lab, reading.used),
        capacities=capacities_of(lab, reading.used),
    )
    state = execute(plumbing_of(lab, reading.used), paper)
    of = {f"step {place}": step for place, (step, _) in enumerate(read, start=1)}
    findings += [*reading.findings, *(_told(one, of, lab) for one in state.findings)]
    return WorkflowProof(
        findings=tuple(findings),
        covered=tuple(step.id for step, _ in read),
        beyond=tuple(reading.beyond),
    )


def _others(
    steps: Mapping[str, Step],
    order: Sequence[str],
    jobs: Mapping[str, Sequence[PlannedJob]],
    lab: PlannerView,
) -> list[Finding]:
    """List the steps that a plan leaves out or has twice, and the jobs of no step of it."""
    wrong = [step for step_id, step in steps.items() if order.count(step_id) != 1]
    found = [
        Finding(NOT_PROVED, not_done(step, lab, "it has the step not at all, or twice"), step.id)
        for step in wrong
    ]
    strange = [one.sentence for step_id in jobs.keys() - steps.keys() for one in jobs[step_id]]
    strange += [step_id for step_id in order if step_id not in steps]
    if strange:
        message = f"the plan cannot be proved: no step asks for {', '.join(sorted(strange))}"
        found.append(Finding(NOT_PROVED, message))
    return found


def _told(found: Finding, of: Mapping[str, Step], lab: PlannerView) -> Finding:
    """Say what the proof found, at the step that a person has drawn."""
    step = of.get(found.subject)
    what = found.message.removeprefix(f"{found.subject}: ")
    context = {**found.context, "found": found.code}
    if step is None:
        return Finding(NOT_PROVED, f"the plan cannot be proved: {what}", "", context)
    return Finding(NOT_PROVED, not_done(step, lab, what), step.id, context)
