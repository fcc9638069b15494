"""What steps, reagents and components may say: the tables as data to check against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from labweb.domain.recipes.xdl.tables import step_table as table


@dataclass(frozen=True, slots=True, kw_only=True)
class Property:
    """One attribute that an element may have."""

    name: str
    sort: str
    """What its text is read as: a quantity, a name of something declared, a choice."""

    choices: tuple[str, ...] = ()
    default: str | None = None
    """What XDL says is meant when it is not written; None: it says nothing."""

    is_required: bool = False
    means: str = ""
    """What a property beside the standard means; "" for one of the standard."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepSpec:
    """One kind of step."""

    name: str
    properties: Mapping[str, Property]
    renamed: Mapping[str, str] = field(default_factory=dict)
    """Old name of a property → its name."""

    one_of: tuple[tuple[str, ...], ...] = ()
    at_most_one: tuple[tuple[str, ...], ...] = ()
    has_children: bool = False
    is_monitor: bool = False
    means: str = ""
    """What a step beside the standard means; "" for one of the standard."""


@dataclass(frozen=True, slots=True)
class StepTable:
    """The steps a reader knows."""

    steps: Mapping[str, StepSpec]

    def spec(self, name: str) -> StepSpec | None:
        """Return what is known of a step, or None."""
        return self.steps.get(name)


def properties_of(line: str, means: Mapping[str, str] | None = None) -> dict[str, Property]:
    """Read one line of the table.

    Example:
        >>> properties_of("time:time! stir:bool=True")["stir"].default
        'True'
    """
    found = {}
    for entry in line.split():
        name, _, rest = entry.partition(":")
        sort, _, default = rest.partition("=")
        choices = tuple(c for c in sort.rstrip("!").split("|") if c) if "|" in sort else ()
        found[name] = Property(
            name=name,
            sort="choice" if choices else sort.rstrip("!"),
            choices=choices,
            default=default or None,
            is_required=sort.endswith("!"),
            means="" if means is None else means[name],
        )
    return found


def step_spec(name: str, line: str, *, is_monitor: bool = False) -> StepSpec:
    """Build the spec of a step from its line, with all that the tables say about it."""
    extended = properties_of(table.EXTENSIONS.get(name, ""), table.EXTENSION_MEANS)
    return StepSpec(
        name=name,
        properties=properties_of(line) | extended | properties_of(table.COMMON),
        renamed=table.RENAMED.get(name, {}),
        one_of=table.ONE_OF.get(name, ()),
        at_most_one=table.AT_MOST_ONE.get(name, ()),
        has_children=name in table.PARENTS,
        is_monitor=is_monitor or name in table.MONITORS,
        means=table.MEANS.get(name, ""),
    )


STEPS = StepTable(
    {name: step_spec(name, line) for name, line in {**table.STANDARD, **table.FURTHER}.items()}
)
"""The steps of the standard and those of published recipes."""

REAGENT = properties_of(table.REAGENT)
COMPONENT = properties_of(table.COMPONENT)
PARAMETER = properties_of(table.PARAMETER)
METADATA = properties_of(table.METADATA)
SYNTHESIS = properties_of(table.SYNTHESIS)
