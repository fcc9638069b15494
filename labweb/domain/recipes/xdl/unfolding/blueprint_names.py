"""What names mean inside a procedure, and what a use of a blueprint makes of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from labweb.domain.errors import UnitError
from labweb.domain.recipes.xdl.file_format.attribute_values import Value, read_value
from labweb.domain.recipes.xdl.file_format.names_in_scope import HARDWARE
from labweb.domain.recipes.xdl.file_format.recipe_model import Component, Procedure, Reagent
from labweb.domain.recipes.xdl.tables.step_spec import REAGENT as REAGENT_PROPERTIES
from labweb.domain.recipes.xdl.unfolding.reagent_amounts import Scale


@dataclass(frozen=True, slots=True)
class Named:
    """A reagent as it is called here, and what is known of it."""

    name: str
    """What the synthesis calls it."""

    facts: Reagent


@dataclass(frozen=True, slots=True, kw_only=True)
class NameContext:
    """What names mean in one procedure."""

    procedure: Procedure
    vessels: Mapping[str, str]
    reagents: Mapping[str, Named]
    parameters: Mapping[str, Value | None]
    scale: Scale


def mapped_vessels(
    blueprint: Procedure, mapping: Mapping[str, str], context: NameContext
) -> dict[str, str]:
    """Say which vessel of the synthesis each name of a blueprint is."""
    found: dict[str, str] = {}
    for component in blueprint.hardware:
        called = mapping.get(component.id, component.id)
        found[component.id] = context.vessels.get(called, called)
    for component in blueprint.hardware:
        called = mapping.get(component.id, component.id)
        # A body may also say what its use maps, as if it stood in the synthesis.
        found.setdefault(called, found[component.id])
        found.setdefault(found[component.id], found[component.id])
    return found


def mapped_reagents(
    blueprint: Procedure, mapping: Mapping[str, str], context: NameContext
) -> dict[str, Named]:
    """Say which reagent of the synthesis each name of a blueprint is."""
    found: dict[str, Named] = {}
    for reagent in blueprint.reagents:
        called = mapping.get(reagent.id, mapping.get(reagent.name, ""))
        named = context.reagents.get(called) if called else Named(reagent.name, reagent)
        found[reagent.id] = named or Named(called, reagent)
    for reagent in blueprint.reagents:
        if reagent.name:
            found.setdefault(reagent.name, found[reagent.id])
    for reagent in blueprint.reagents:
        called = mapping.get(reagent.id, mapping.get(reagent.name, ""))
        if called:
            found.setdefault(called, found[reagent.id])
            # The same reagent by the name that a use further out gives it.
            found.setdefault(found[reagent.id].name, found[reagent.id])
    return found


def matching(clauses: list[tuple[str, str]], procedure: Procedure) -> list[Component | Reagent]:
    """List what all clauses of a loop variable fit, in the order of declaration.

    Inside a blueprint its own declarations are matched, not those of what is mapped to them.
    """
    names = {attribute for attribute, _ in clauses}
    is_hardware = ("kind", HARDWARE) in clauses or bool(names & {"type", "chemical"})
    entries: tuple[Component | Reagent, ...] = (
        procedure.hardware if is_hardware else procedure.reagents
    )
    return [e for e in entries if all(_fits(e, name, value) for name, value in clauses)]


def _fits(entry: Component | Reagent, attribute: str, value: str) -> bool:
    if attribute == "kind":
        return True
    if isinstance(entry, Component):
        return bool(getattr(entry, attribute, None) == value)
    if attribute in {"id", "name"}:
        return bool(getattr(entry, attribute) == value)
    wanted = REAGENT_PROPERTIES[attribute]
    own = entry.values.get(attribute)
    if own is None and wanted.default is not None:
        own = read_value(wanted.default, wanted)
    try:
        return own == read_value(value, wanted)
    except UnitError:
        return False
