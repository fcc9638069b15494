"""What a recipe says beside its steps, and no plan does."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from labweb.domain.recipes.xdl.expansion.basic_operations import BasicOperation
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.file_format.recipe_model import Procedure, Reagent

_UNDONE = (
    *("atmosphere", "clean_with", "cleaning_solvent", "incompatible_reagents", "preserve"),
    *("purity", "stir", "temp"),
)
_LATE = "last_minute_addition"


def check_reagents(
    reagents: Iterable[Reagent], operations: Iterable[BasicOperation], told: Findings
) -> None:
    """Tell of a reagent that something is to be added to before it is used: no plan does it."""
    for reagent in _used(reagents, operations):
        if _LATE in reagent.values:
            message = (
                f"{reagent.values[_LATE]} is to be added to {reagent.id} before it is used, which "
                "no plan does: write it as steps"
            )
            told.tell("plan.not_compiled", message, reagent.place)


def say_unheeded(procedure: Procedure, operations: Iterable[BasicOperation]) -> Iterator[str]:
    """Yield a note for all that a recipe says beside its steps and no plan does."""
    if procedure.habits:
        yield f"the recipe says {', '.join(procedure.habits)}, which no plan does"
    for reagent in _used(procedure.reagents, operations):
        said = [name for name in _UNDONE if reagent.values.get(name) not in (None, False)]
        if said:
            place = f"{reagent.id} in line {reagent.place.line}"
            yield f"{place}: the recipe says {', '.join(said)}, which no plan does"


def _used(reagents: Iterable[Reagent], operations: Iterable[BasicOperation]) -> Iterator[Reagent]:
    names = {one.fields.get(name) for one in operations for name in ("reagent", "solvent")}
    names |= {one.fields.get("source") for one in operations}
    yield from (reagent for reagent in reagents if {reagent.id, reagent.name} & names)
