"""Which names mean something at one place of a recipe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from labweb.domain.recipes.xdl.file_format.recipe_model import Procedure, XdlParameter
from labweb.domain.recipes.xdl.file_format.xml_tree import FilePlace

HARDWARE, REAGENT = "Hardware", "Reagent"


@dataclass(frozen=True, slots=True, kw_only=True)
class Missed:
    """A name that is not declared where it is used."""

    kind: str
    """`Hardware` or `Reagent`."""

    name: str
    property: str
    place: FilePlace


@dataclass(frozen=True, slots=True, kw_only=True)
class Scope:
    """The names that steps of one procedure may use."""

    vessels: frozenset[str]
    reagents: frozenset[str]
    parameters: Mapping[str, XdlParameter]
    variables: Mapping[str, str] = field(default_factory=dict)
    """Loop variable → `Hardware` or `Reagent`."""

    def has_vessel(self, name: str) -> bool:
        """Tell whether a vessel may be called so here."""
        return name in self.vessels or self.variables.get(name) == HARDWARE

    def has_reagent(self, name: str) -> bool:
        """Tell whether a reagent may be called so here."""
        return name in self.reagents or self.variables.get(name) == REAGENT

    def has_any(self, name: str) -> bool:
        """Tell whether anything is called so here."""
        return (
            name in self.vessels
            or name in self.reagents
            or name in self.parameters
            or name in self.variables
        )

    def inside(self, variables: Mapping[str, str]) -> Scope:
        """Return the scope inside a loop."""
        return replace(self, variables={**self.variables, **variables})


def scope_of(procedure: Procedure, rig_vessels: frozenset[str] = frozenset()) -> Scope:
    """Build the scope of a procedure; vessels of a rig count as declared when they are given."""
    names = {r.id for r in procedure.reagents} | {r.name for r in procedure.reagents if r.name}
    return Scope(
        vessels=frozenset(c.id for c in procedure.hardware) | rig_vessels,
        reagents=frozenset(names),
        parameters={p.id: p for p in procedure.parameters},
    )
