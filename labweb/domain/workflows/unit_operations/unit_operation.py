"""What a unit operation is: its parameters, its ports and the schema of its form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Any

from labweb.domain.dimensions import DIMENSIONS

LONGEST_REFERENCE = 80
LONGEST_QUANTITY = 64
ALL = "all"
"""All that is there, in the place of an amount."""

NONE = "none"
"""Nothing of it, in the place of the mass of a solid."""


class PortKind(StrEnum):
    """What an edge between two ports means; only equal kinds connect."""

    DONE = "done"
    """Order alone: ▸."""

    MATERIAL = "material"
    """The same vessel goes on into the next step: ●."""

    DATA = "data"
    """A measured value: ◆."""


class ParameterSort(StrEnum):
    """How a parameter is written."""

    QUANTITY = "quantity"
    """Text with a unit, as typed."""

    RESOURCE = "resource"
    """UUID of a resource as text, or `@key` in a template."""

    NAME = "name"
    """Short text: the name of an action."""

    TEXT = "text"
    """One line of text: the key of a lot, a reason."""

    AMOUNTS = "amounts"
    """Object: an amount as typed by the key of a lot."""

    SWITCH = "switch"
    """True or false; left out is false. In a sentence it is no word: its clause stands or not."""

    ARGUMENTS = "arguments"
    """Object: what the action of a device is called with."""


@dataclass(frozen=True, slots=True)
class StepPort:
    """One connection point of a step."""

    name: str
    kind: PortKind
    label: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StepParameter:
    """One field of a step's form."""

    name: str
    sort: ParameterSort
    label: str
    help: str
    quantity: str = ""
    """Dimension, for a quantity."""

    wants: Mapping[str, Any] = field(default_factory=dict)
    """Which resources may stand here: `{"holds": "liquid"}` or `{"kind": [...]}`."""

    is_required: bool = True
    is_advanced: bool = False
    longest: int = LONGEST_REFERENCE
    """Most characters of a line of text."""

    takes_all: bool = False
    """`all` may stand in the place of a volume."""

    may_come_later: bool = False
    """Left out, a person states it during the run, when the turn of its step comes."""

    is_of_solids: bool = False
    """It says what comes of the solids in a vessel; without any there is nothing to state."""

    @property
    def is_vessel(self) -> bool:
        """Tell whether this names a vessel, which material ports carry."""
        return self.wants.get("holds") == "liquid"

    def means_all(self, value: object) -> bool:
        """Tell whether all there is by then is asked for, where that may be."""
        return self.takes_all and value == ALL

    def takes_text(self, value: object) -> bool:
        """Tell whether a name or a line of text may stand here."""
        if not isinstance(value, str) or not 0 < len(value.strip()) <= self.longest:
            return False
        return value.isidentifier() if self.sort is ParameterSort.NAME else value.isprintable()

    def schema(self, order: int) -> dict[str, Any]:
        """Render as JSON Schema 2020-12 with the hints a form is drawn from."""
        schema: dict[str, Any] = {
            "x-label": self.label,
            "x-help": self.help,
            "x-order": order,
            "x-advanced": self.is_advanced,
        }
        match self.sort:
            case ParameterSort.QUANTITY:
                unit = next(iter(DIMENSIONS[self.quantity].units))
                hints: dict[str, Any] = {"x-quantity": self.quantity, "x-unit": unit}
                hints |= {"x-all": True} if self.takes_all else {}
                return {"type": "string", "maxLength": LONGEST_QUANTITY, **hints, **schema}
            case ParameterSort.RESOURCE:
                hint = {"x-resource": dict(self.wants)}
                return {"type": "string", "maxLength": LONGEST_REFERENCE, **hint, **schema}
            case ParameterSort.NAME | ParameterSort.TEXT:
                return {"type": "string", "maxLength": self.longest, **schema}
            case ParameterSort.AMOUNTS:
                amount = {"type": "string", "maxLength": LONGEST_QUANTITY}
                return {"type": "object", "additionalProperties": amount, **schema}
            case ParameterSort.SWITCH:
                return {"type": "boolean", **schema}
            case ParameterSort.ARGUMENTS:
                return {"type": "object", **schema}


class Moves(StrEnum):
    """What a unit operation does to matter, as the proof of a plan checks it."""

    LIQUID = "liquid"
    """A volume, or all there is, goes from one vessel to another."""

    LAYER = "layer"
    """The lots that a person states go over as liquid, and no other."""

    FILTRATE = "filtrate"
    """All liquid goes over, and every solid stays."""

    VAPOUR = "vapour"
    """The lots that a person states go over when the time is over."""

    SOLID = "solid"
    """A mass of a solid goes from one vessel to another, by the hand of a person."""

    GAS = "gas"
    """A gas goes over, and no liquid."""

    REACTION = "reaction"
    """What a person states comes of the lots in a vessel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepMatter:
    """What a step does to matter, for the proof; a step without it may change none."""

    moves: Moves | None = None
    """None: no proof follows it."""

    source: str = ""
    """Parameter that says from where; a step that leaves it or `target` out moves nothing."""

    target: str = ""
    stated: str = ""
    """Parameter that states the lots."""

    unproved: str = ""
    """Why it is not proved where it has no claim, and changes matter all the same."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitOperation:
    """One sort of step."""

    kind: str
    label: str
    help: str
    parameters: tuple[StepParameter, ...]
    clauses: tuple[str, ...]
    """Pieces of the sentence; a piece whose optional field is not set is left out."""

    measures: str = ""
    """Label of the value it gives, "" when it measures nothing."""

    matter: StepMatter | None = None

    def parameter(self, name: str) -> StepParameter | None:
        """Return the parameter of that name, or None."""
        return next((p for p in self.parameters if p.name == name), None)

    def left_open(self, params: Mapping[str, Any]) -> StepParameter | None:
        """Return what a person states during the run, whatever is in the vessel by then."""
        later = (p for p in self.parameters if p.may_come_later and not p.is_of_solids)
        return next((p for p in later if p.name not in params), None)

    @property
    def inputs(self) -> tuple[StepPort, ...]:
        """Ports an edge may end at."""
        return (StepPort("start", PortKind.DONE, "Start"), *self._materials())

    @property
    def outputs(self) -> tuple[StepPort, ...]:
        """Ports an edge may begin at."""
        value = (StepPort("value", PortKind.DATA, self.measures),) if self.measures else ()
        return (StepPort("done", PortKind.DONE, "Done"), *self._materials(), *value)

    def _materials(self) -> tuple[StepPort, ...]:
        vessels = (p for p in self.parameters if p.is_vessel)
        return tuple(StepPort(p.name, PortKind.MATERIAL, p.label) for p in vessels)

    def schema(self) -> dict[str, Any]:
        """Render the parameters as JSON Schema 2020-12."""
        return {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": self.label,
            "description": self.help,
            "type": "object",
            "properties": {
                p.name: p.schema(order) for order, p in enumerate(self.parameters, start=1)
            },
            "required": [p.name for p in self.parameters if p.is_required],
            "additionalProperties": False,
        }

    def to_json(self) -> dict[str, Any]:
        """Render as one entry of the palette."""
        return {
            "kind": self.kind,
            "label": self.label,
            "help": self.help,
            "clauses": list(self.clauses),
            "inputs": [asdict(port) for port in self.inputs],
            "outputs": [asdict(port) for port in self.outputs],
            "params": self.schema(),
        }


def vessel(name: str, label: str, help_text: str) -> StepParameter:
    """Return a parameter that names a vessel that liquid stands in."""
    return StepParameter(
        name=name,
        sort=ParameterSort.RESOURCE,
        label=label,
        help=help_text,
        wants={"holds": "liquid"},
    )


def quantity(name: str, quantity: str, label: str, help_text: str) -> StepParameter:
    """Return a parameter that is a quantity with its unit."""
    sort = ParameterSort.QUANTITY
    return StepParameter(name=name, sort=sort, label=label, help=help_text, quantity=quantity)


def portion(name: str, label: str, help_text: str) -> StepParameter:
    """Return a parameter that is a volume, or all there is by then."""
    return replace(quantity(name, "volume", label, help_text), takes_all=True)


def device(name: str, kinds: list[str], label: str, help_text: str) -> StepParameter:
    """Return a parameter that names a resource of some kinds; of none, whatever acts."""
    wants: dict[str, Any] = {"kind": kinds} if kinds else {"acts": True}
    sort = ParameterSort.RESOURCE
    return StepParameter(name=name, sort=sort, label=label, help=help_text, wants=wants)


def text(name: str, label: str, help_text: str) -> StepParameter:
    """Return a parameter that is a line of text."""
    return StepParameter(name=name, sort=ParameterSort.TEXT, label=label, help=help_text)


def port(name: str, of: str) -> StepParameter:
    """Return a parameter that names a port of the vessel that another one names."""
    help_text = f"Port of '{of}' by which it goes, such as top; any of them when left empty."
    return advanced(text(name, f"Port of '{of}'", help_text))


def lots(name: str, label: str, help_text: str) -> StepParameter:
    """Return a parameter that is an amount by the key of a lot."""
    sort = ParameterSort.AMOUNTS
    return StepParameter(name=name, sort=sort, label=label, help=help_text)


def later(parameter: StepParameter) -> StepParameter:
    """Let a parameter be left out until the run, when a person states it."""
    text = f"{parameter.help} Left empty, it is asked for during the run."
    return replace(parameter, is_required=False, may_come_later=True, help=text)


def solids(name: str, label: str, help_text: str) -> StepParameter:
    """Return a parameter that says what comes of each solid in a vessel, before or in the run."""
    stated = f"{help_text} Each solid that is in it has to be stated: a mass, all or none."
    return replace(later(lots(name, label, stated)), is_of_solids=True)


def switch(name: str, label: str, help_text: str) -> StepParameter:
    """Return a parameter that is on or off; left out is off."""
    return StepParameter(
        name=name, sort=ParameterSort.SWITCH, label=label, help=help_text, is_required=False
    )


def optional(parameter: StepParameter) -> StepParameter:
    """Let a parameter be left out."""
    return replace(parameter, is_required=False)


def advanced(parameter: StepParameter) -> StepParameter:
    """Let a parameter be left out, and out of sight."""
    return replace(parameter, is_required=False, is_advanced=True)
