"""Unit operations of a person: what somebody confirms, and what somebody does by hand."""

from __future__ import annotations

from dataclasses import replace

from labweb.domain.workflows.unit_operations.unit_operation import (
    Moves,
    StepMatter,
    UnitOperation,
    quantity,
    text,
    vessel,
)

LONGEST_QUESTION = 200
"""Characters of what a person is asked: it stands in the sentence of a job."""

PERSON_STEPS = (
    UnitOperation(
        kind="confirm",
        label="Ask a person",
        help="Wait until somebody has read a question on the page of the run and confirmed it.",
        parameters=(
            replace(
                text("question", "Question", "What is to be confirmed: The stopcock is closed."),
                longest=LONGEST_QUESTION,
            ),
        ),
        clauses=("Ask a person: {question}",),
    ),
    UnitOperation(
        kind="add_solid",
        matter=StepMatter(moves=Moves.SOLID, source="source", target="target"),
        label="Add a solid by hand",
        help="A person weighs a solid in, confirms it on the page of the run, and the record "
        "follows.",
        parameters=(
            vessel("source", "From", "Vessel that the solid is taken from."),
            vessel("target", "To", "Vessel that the solid is put into."),
            quantity("mass", "mass", "Mass", "How much is weighed in, such as 5 g."),
        ),
        clauses=("Weigh {mass} from {source} into {target} by hand",),
    ),
)
"""In the order of the palette."""
