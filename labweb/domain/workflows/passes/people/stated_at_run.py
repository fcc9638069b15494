"""What a step leaves open until the run: a person states it once the step's turn has come.

```text
asked ──▶ stated ──▶ what is left of the run is planned again, proved, and goes on
```

Until then the step and all that comes after it are planned as if half of each lot were meant, so
that a device that is missing, or a way that there is not, is refused before anything moves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from uuid import UUID

from labweb.domain.resources.contents_by_lot import LotId, Phase, take, total_nl
from labweb.domain.workflows.passes.drafted_jobs import Drafting, DraftJob
from labweb.domain.workflows.passes.people.person_jobs import ask_person
from labweb.domain.workflows.plan import LotStatement
from labweb.domain.workflows.unit_operations.step_palette import STEP_KINDS
from labweb.domain.workflows.unit_operations.unit_operation import StepParameter
from labweb.domain.workflows.workflow_file import Step


def left_open(step: Step) -> StepParameter | None:
    """Return the parameter of a step that a person states during the run; None: none."""
    return STEP_KINDS[step.kind].left_open(step.params)


def half_of(step: Step, drafting: Drafting, vessel: UUID) -> Mapping[LotId, int] | None:
    """Return half of what a vessel holds by then, for the plan of what is left open.

    None: it holds nothing that could be stated, which is refused.
    """
    held = drafting.contents(vessel)
    half_nl = total_nl(held) // 2
    if not half_nl:
        message = f"{drafting.name(vessel)} holds no liquid by then"
        drafting.refuse(step, "plan.nothing_there", message, "params.vessel")
        return None
    return take(held, half_nl)


def ask_to_state(
    step: Step,
    drafting: Drafting,
    vessel: UUID,
    parameter: StepParameter,
    question: str,
    phases: tuple[Phase, ...] = (Phase.LIQUID,),
) -> DraftJob | None:
    """Make the job in whose place a person states a parameter of the step."""
    asked = ask_person(step, drafting, question, sentence=question, locks=(vessel,))
    states = LotStatement(
        field=parameter.name,
        label=parameter.label,
        resource_id=vessel,
        phases=phases,
        leaves_out=not parameter.is_of_solids,
    )
    return None if asked is None else replace(asked, states=states)


def ask_of_solids(
    step: Step, drafting: Drafting, vessel: UUID, parameter: StepParameter
) -> DraftJob | None:
    """Make the job in whose place a person states what comes of the solids in a vessel."""
    name = drafting.name(vessel)
    question = f"How much of each solid in {name} goes along with its liquid?"
    if parameter.name == "stays":
        question = f"How much of each solid stays on {name}?"
    return ask_to_state(step, drafting, vessel, parameter, question, (Phase.SOLID,))
