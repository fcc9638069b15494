"""Expands unfolded acts into basic operations over the vessels of the recipe.

Loops and what runs beside stay a tree, for how they run is a matter of time and sensors. At the
end everything that was switched on and never off is switched off.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from labweb.domain.recipes.xdl.expansion.act_reading import ActReading
from labweb.domain.recipes.xdl.expansion.basic_operations import BasicKind, BasicOperation, Field
from labweb.domain.recipes.xdl.expansion.operations_table import OPERATIONS
from labweb.domain.recipes.xdl.file_format.findings import Findings
from labweb.domain.recipes.xdl.file_format.read_xdl import refusal
from labweb.domain.recipes.xdl.unfolding.act_order import RecipeAct

_OFF = {
    BasicKind.START_STIR: BasicKind.STOP_STIR,
    BasicKind.SET_TEMPERATURE: BasicKind.STOP_TEMPERATURE,
    BasicKind.START_VACUUM: BasicKind.STOP_VACUUM,
    BasicKind.START_GAS: BasicKind.STOP_GAS,
    BasicKind.START_ROTATION: BasicKind.STOP_ROTATION,
    BasicKind.START_LIGHT: BasicKind.STOP_LIGHT,
    BasicKind.START_ULTRASOUND: BasicKind.STOP_ULTRASOUND,
}
"""What ends what was begun."""

_IDLE = frozenset({BasicKind.STOP_STIR, BasicKind.STOP_TEMPERATURE})
"""Said to make sure; dropped for a vessel that is never begun with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Expansion:
    """One act with the basic operations it is made of."""

    act: RecipeAct
    operations: tuple[BasicOperation, ...] = ()
    children: tuple[Expansion, ...] = ()
    """For a blueprint, a loop and an Async."""

    unheeded: tuple[str, ...] = ()
    """Properties that the recipe gives and none of the operations does."""


def expand(acts: tuple[RecipeAct, ...]) -> tuple[Expansion, ...]:
    """Expand the acts of a recipe.

    Raises:
        ProtocolError: `xdl.left_open`, `xdl.word_unresolved`, `xdl.range_not_exact`,
            `xdl.not_expanded`; `findings` list everything that no table can fill in.
    """
    told = Findings()
    expanded = tuple(_expanded(act, told) for act in acts)
    if told.all:
        raise refusal(told.all)
    begun = {
        (_OFF[o.kind], o.fields.get("vessel")) for o in all_operations(expanded) if o.kind in _OFF
    }
    kept = tuple(_without_idle(one, begun) for one in expanded)
    end = tuple(_shutdown(kept))
    return (*kept, Expansion(act=RecipeAct(name="Shutdown"), operations=end)) if end else kept


def all_operations(expanded: tuple[Expansion, ...]) -> Iterator[BasicOperation]:
    """Yield the basic operations in the order of the recipe, each loop once."""
    for one in expanded:
        yield from one.operations
        yield from all_operations(one.children)


def _expanded(act: RecipeAct, told: Findings) -> Expansion:
    children = tuple(_expanded(child, told) for child in act.children)
    operation = OPERATIONS.get(act.name)
    if act.is_blueprint or (operation is not None and operation.expand is None and children):
        undone = tuple(name for name in ("on_finish",) if name in act.values)
        return Expansion(act=act, children=children, unheeded=undone)
    if operation is None or operation.expand is None:
        message = f"nothing says what {act.name} does with matter"
        told.tell("xdl.not_expanded", message, act.place)
        return Expansion(act=act)
    reading = ActReading(act, told)
    operations = tuple(operation.expand(reading))
    left = reading.unheeded()
    return Expansion(act=act, operations=operations, children=children, unheeded=left)


def _without_idle(one: Expansion, begun: set[tuple[BasicKind, Field]]) -> Expansion:
    kept = tuple(
        o
        for o in one.operations
        if o.kind not in _IDLE or (o.kind, o.fields.get("vessel")) in begun
    )
    children = tuple(_without_idle(child, begun) for child in one.children)
    return replace(one, operations=kept, children=children)


def _shutdown(expanded: tuple[Expansion, ...]) -> Iterator[BasicOperation]:
    running: dict[tuple[BasicKind, Field], BasicOperation] = {}
    for operation in all_operations(expanded):
        vessel = operation.fields.get("vessel")
        if operation.kind in _OFF:
            running[_OFF[operation.kind], vessel] = operation
        else:
            running.pop((operation.kind, vessel), None)
    for (kind, vessel), begun in running.items():
        yield BasicOperation(kind=kind, fields={"vessel": vessel}, place=begun.place)
