"""A recipe as XDL says it: what there is, and what is done with it, still without a rig."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from labweb.domain.recipes.xdl.file_format.attribute_values import Value
from labweb.domain.recipes.xdl.file_format.xml_tree import NOWHERE, FilePlace, XmlDocument


@dataclass(frozen=True, slots=True, kw_only=True)
class Component:
    """A vessel or another piece of hardware that the recipe names."""

    id: str
    type: str
    chemical: str = ""
    """What it is filled with, for a cartridge or a flask."""

    place: FilePlace = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reagent:
    """A material in a role."""

    id: str
    """What steps call it."""

    name: str
    """The substance; "" for a role that whoever uses the blueprint fills."""

    values: Mapping[str, Value] = field(default_factory=dict)
    place: FilePlace = field(default=NOWHERE, compare=False)

    @property
    def is_solid(self) -> bool:
        """Tell whether the recipe calls it solid."""
        return self.values.get("solid") is True


@dataclass(frozen=True, slots=True, kw_only=True)
class XdlParameter:
    """A value that is given when the recipe is used."""

    id: str
    sort: str
    value: Value | None = None
    least: Value | None = None
    most: Value | None = None
    place: FilePlace = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class XdlStep:
    """One step as written: its values read, its names checked, nothing filled in."""

    name: str
    values: Mapping[str, Value] = field(default_factory=dict)
    """By the name of the property since 0.4."""

    children: tuple[XdlStep, ...] = ()
    section: str = ""
    """`Prep`, `Reaction`, `Workup` or `Purification`; "" outside of them."""

    loop: tuple[tuple[str, str, str], ...] = ()
    """Clauses of a Repeat: variable, attribute, value."""

    mapping: Mapping[str, str] = field(default_factory=dict)
    """Use of a blueprint: its id → what stands for it here."""

    place: FilePlace = field(default=NOWHERE, compare=False)

    @property
    def queue(self) -> str:
        """Return the queue, "" for the root queue."""
        found = self.values.get("queue", "")
        return found if isinstance(found, str) else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Procedure:
    """Hardware, reagents, parameters and steps: a Synthesis or a Blueprint."""

    id: str
    hardware: tuple[Component, ...] = ()
    reagents: tuple[Reagent, ...] = ()
    parameters: tuple[XdlParameter, ...] = ()
    steps: tuple[XdlStep, ...] = ()
    base_scale: Value | None = None
    """mol of one equivalent for which a blueprint was worked out."""

    graph_sha256: str = ""
    """Compiled for this graph alone; "" for a recipe that is not compiled."""

    habits: tuple[str, ...] = ()
    """Attributes by which recipes before 0.4 ask a platform to clean of its own accord."""

    place: FilePlace = field(default=NOWHERE, compare=False)

    def component(self, name: str) -> Component | None:
        """Return the component of that id, or None."""
        return next((c for c in self.hardware if c.id == name), None)

    def reagent(self, name: str) -> Reagent | None:
        """Return the reagent of that id, or of that name when no id fits, or None."""
        by_id = next((r for r in self.reagents if r.id == name), None)
        return by_id or next((r for r in self.reagents if r.name == name), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """Everything one file holds."""

    document: XmlDocument = field(repr=False)
    """The file itself, with comments and places; what is written back."""

    version: str = ""
    """As the file declares it; "" when it does not."""

    syntheses: tuple[Procedure, ...] = ()
    blueprints: Mapping[str, Procedure] = field(default_factory=dict)

    @property
    def synthesis(self) -> Procedure:
        """Return the only synthesis.

        Raises:
            ValueError: There are several, or none: name one of `syntheses`.
        """
        if len(self.syntheses) != 1:
            raise ValueError(f"the file holds {len(self.syntheses)} syntheses")
        return self.syntheses[0]

    @property
    def is_compiled(self) -> bool:
        """Tell whether this is the output of a compiler, bound to one graph."""
        return any(synthesis.graph_sha256 for synthesis in self.syntheses)
