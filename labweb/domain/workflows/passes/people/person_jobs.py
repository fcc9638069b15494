"""Jobs that wait for a person: nothing of them is sent to a host before somebody confirmed.

```text
queued ──▶ a person confirms ──▶ dispatched to a timer ──▶ complete: the record follows
```
"""

from __future__ import annotations

from dataclasses import replace
from uuid import UUID

from labweb.domain.crutd.operations import Operation, TransferMass
from labweb.domain.resources.contents_by_lot import Phase, take, total_nl
from labweb.domain.units import parse_mass_ug
from labweb.domain.workflows.passes.devices.heat_stir_wait_measure import draft_of, free_timer
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob, DraftStep
from labweb.domain.workflows.unit_operations.step_palette import sentence_text
from labweb.domain.workflows.workflow_file import Step

BY_HAND_S = 120.0
"""How long a person is expected to take."""


def plan_confirm(step: Step, drafting: Drafting) -> DraftStep:
    """Ask a question. Moves nothing."""
    question = str(step.params["question"]).strip()
    job = ask_person(step, drafting, question, sentence=f"Ask a person: {question}")
    return draft_of(step, [job])


def plan_add_solid(step: Step, drafting: Drafting) -> DraftStep:
    """Have a person weigh a solid in; what they confirm is booked as asked."""
    source, target = UUID(step.params["source"]), UUID(step.params["target"])
    mass_ug = parse_mass_ug(step.params["mass"])
    there = drafting.solids(source)
    parts = take(there, min(mass_ug, total_nl(there)))
    move = TransferMass(
        source_id=source,
        target_id=target,
        amount_ug=mass_ug,
        phase=Phase.SOLID,
        parts_ug={str(lot): part for lot, part in sorted(parts.items())},
    )
    text = sentence_text(step.kind, step.params, drafting.view.names)
    job = ask_person(
        step,
        drafting,
        f"{text}. Is it done?",
        sentence=text,
        operation=move,
        locks=(source, target),
    )
    return draft_of(step, [job])


def ask_person(
    step: Step,
    drafting: Drafting,
    question: str,
    *,
    sentence: str,
    operation: Operation | None = None,
    locks: tuple[UUID, ...] = (),
) -> DraftJob | None:
    """Make a job that a timer ends as soon as a person has confirmed it."""
    timer = free_timer(step, drafting, "")
    if timer is None:
        return None
    job = drafting.job(
        step,
        timer,
        "wait",
        {"duration_s": 0.0},
        sentence=sentence,
        operation=operation,
        locks=locks,
        estimate_s=BY_HAND_S,
    )
    return None if job is None else replace(job, asks=question)
