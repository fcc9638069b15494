"""What a step asks to have confirmed, and whether it may stay unconfirmed."""

from __future__ import annotations

from labweb.domain.workflows.passes.drafted_jobs import Drafting
from labweb.domain.workflows.unit_operations.liquid_steps import (
    MAY_STAY_UNCONFIRMED as MAY_STAY_UNCONFIRMED,
)
from labweb.domain.workflows.workflow_file import Step


def may_confirm(step: Step, drafting: Drafting) -> bool:
    """Say whether a step names what confirms it.

    A finding is noted for one that lets its confirmation stay out and asks for none.
    """
    if "confirm_with" in step.params:
        return True
    if step.params.get(MAY_STAY_UNCONFIRMED) is True:
        at = f"params.{MAY_STAY_UNCONFIRMED}"
        message = (
            "the step asks for no confirmation that may stay out: name what confirms it, or "
            "untick *may stay unconfirmed*"
        )
        drafting.refuse(step, "plan.nothing_to_confirm", message, at)
    return False
