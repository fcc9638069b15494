"""What a recipe leaves open about one lab and about matter, stated by a person in a file beside it.

A recipe names vessels by its own names, and says nothing of which lot lies in which layer, what
boils off, and what a reaction makes. None of it is inferred.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from labweb.domain.errors import Finding, LabFileError, ProtocolError
from labweb.domain.graph.lab_file.untrusted_json import decode_json
from labweb.domain.recipes.xdl.file_format.recipe_model import Recipe, XdlStep
from labweb.domain.workflows.unit_operations.unit_operation import ALL

SCHEMA = "labweb.declared/1"
_CODE = "xdl.not_declared"

Key = Annotated[str, Meta(min_length=1, max_length=80)]


class _Strict(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all entries."""


class DeclaredReaction(_Strict, frozen=True, kw_only=True):
    """A step `react` behind one step of the recipe."""

    after: Annotated[int, Meta(ge=1)]
    """Number of that step in the recipe, from 1, as it is unfolded."""

    params: dict[str, Any]
    """Parameters of the step, vessels as `@key`."""


class Declared(_Strict, frozen=True, kw_only=True):
    """Everything that is stated."""

    schema: str = SCHEMA
    keys: dict[str, Key] = {}
    """Vessel, reagent, gas or filling of the recipe → key of the resource in the lab."""

    groups: dict[str, list[Key]] = {}
    """Reagent, or what lines are rinsed with → groups of substances, those of its solvent too."""

    waste: Key = ""
    """Where a layer goes that nobody wants."""

    buffers: list[Key] = []
    """Empty flasks for what a Separate sets aside: between two rounds, and over all of them."""

    receivers: dict[str, Key] = {}
    """Vessel of the recipe that evaporates or dries → key of the flask its vapour condenses in."""

    lower_layers: list[list[Key]] = []
    """Keys of the lots in the lower layer, for each parting of the recipe in order. None, or no
    more entries: a person states them during the run."""

    boils_off: list[list[Key]] = []
    """The same of the lots that boil off, for each evaporation in order."""

    stays: list[list[Key]] = []
    """Keys of the solid lots that stay on the filter, for each Filter and WashSolid in order."""

    dries_off: list[list[Key]] = []
    """Keys of the lots that dry off, for each Dry in order; none: nothing wet is left by then."""

    reactions: list[DeclaredReaction] = []


def read_declared(raw: bytes) -> Declared:
    """Read the file.

    Raises:
        ProtocolError: It is not as above; `xdl.not_declared`.
    """
    try:
        found = msgspec.convert(decode_json(raw), Declared)
    except (LabFileError, msgspec.ValidationError) as error:
        message = f"what is stated beside the recipe cannot be read: {error}"
        raise _refusal([Finding(_CODE, message)]) from error
    if found.schema != SCHEMA:
        raise _refusal([Finding(_CODE, f"schema is {found.schema!r}, not {SCHEMA!r}")])
    return found


def bindings(declared: Declared, recipe: Recipe) -> dict[str, str]:
    """Return the stated keys of what a recipe declares: vessels, reagents, fillings.

    Raises:
        ProtocolError: `xdl.not_declared`, for each name that the recipe says nowhere.
    """
    unknown = check_names(declared, recipe)
    if unknown:
        raise _refusal(unknown)
    syntheses = recipe.syntheses
    names = {component.id for synthesis in syntheses for component in synthesis.hardware}
    names |= {reagent.id for synthesis in syntheses for reagent in synthesis.reagents}
    return {name: key for name, key in declared.keys.items() if name in names}


def check_names(declared: Declared, recipe: Recipe) -> list[Finding]:
    """List the names of which something is stated and that the recipe says nowhere."""
    names: set[str] = set()
    for procedure in (*recipe.syntheses, *recipe.blueprints.values()):
        names |= {one.id for one in procedure.hardware} | {one.id for one in procedure.reagents}
        names |= set(_texts(procedure.steps))
    parts: dict[str, Mapping[str, object]] = {
        "keys": declared.keys,
        "receivers": declared.receivers,
    }
    return [
        Finding(_CODE, f"{name!r} is stated among the {part}; the recipe says it nowhere", "", at)
        for part, stated in parts.items()
        for at in ({"at": part},)
        for name in sorted(stated.keys() - names)
    ]


def _texts(steps: Iterable[XdlStep]) -> Iterator[str]:
    for step in steps:
        yield from (value for value in step.values.values() if isinstance(value, str))
        yield from _texts(step.children)


def _refusal(findings: list[Finding]) -> ProtocolError:
    return ProtocolError(findings[0].message, code=_CODE, findings=findings)


def stated_at(lists: list[list[str]], place: int) -> list[str]:
    """Return what is stated of one place of a recipe; nothing: a person states it in the run."""
    return lists[place] if place < len(lists) else []


def all_of(lots: list[str]) -> dict[str, str]:
    """Return the parameter of a step that means all there is of some lots."""
    return dict.fromkeys(lots, ALL)
