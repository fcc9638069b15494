"""The few basic operations that every unit operation is made of.

They name vessels and reagents of the recipe and say nothing of pumps, valves or wires: which
device does it, and by which route, is the compiler's work.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from enum import StrEnum

from labweb.domain.recipes.xdl.file_format.xml_tree import NOWHERE, FilePlace

WASTE = "@waste"
"""A waste of the rig, to be chosen by what goes into it."""

INERT_GAS = "@inert_gas"
"""Any inert gas of the rig."""


BUFFER = "@buffer"
"""An empty vessel of the rig that keeps a phase for a while."""

KEPT = "@kept"
"""An empty vessel of the rig that collects a phase over all rounds of a Separate."""


class BasicKind(StrEnum):
    """What a basic operation does."""

    ADD_LIQUID = "add_liquid"
    """`reagent`, `vessel`, `volume_ml` (or all of it); `over_s`, `rate_ml_min`, `is_dropwise`."""

    ADD_SOLID = "add_solid"
    """`reagent`, `vessel`, `mass_g`: a person does it, or a dispenser."""

    TRANSFER = "transfer"
    """`source`, `target`, `volume_ml` (or all of it), `through`, ports, `over_s`."""

    START_STIR = "start_stir"
    STOP_STIR = "stop_stir"
    SET_TEMPERATURE = "set_temperature"
    """`vessel`, `temperature_c`: start heating or chilling."""

    AWAIT_TEMPERATURE = "await_temperature"
    """`vessel`, `low_c`, `high_c`."""

    STOP_TEMPERATURE = "stop_temperature"
    WAIT = "wait"
    START_VACUUM = "start_vacuum"
    """`vessel`, `pressure_mbar` when the recipe says one."""

    STOP_VACUUM = "stop_vacuum"
    """Stop the vacuum; `gas` fills the vessel, and air where none is named."""

    START_GAS = "start_gas"
    """`vessel`, `gas`, `flow_ml_min`, `pressure_mbar`."""

    STOP_GAS = "stop_gas"
    SEPARATE_PHASES = "separate_phases"
    """`vessel`, `lower_to`, `upper_to`, `lower_through`, `upper_through`. A phase that goes to the
    vessel itself is in it afterwards, alone. `waits_in`: where the recipe would let a phase wait
    that goes to `@buffer`. `lower_port`, `upper_port`: ports of the vessels that they go to.
    `conducting_phase`: `top` or `bottom` conducts better. `step_ml`: the lower phase is drawn in
    portions of that."""

    DRAW_FILTRATE = "draw_filtrate"
    """`vessel`, `target`, `volume_ml` (or all of it)."""

    START_ROTATION = "start_rotation"
    STOP_ROTATION = "stop_rotation"
    LOWER_FLASK = "lower_flask"
    """Put the flask of a rotary evaporator into its bath."""

    RAISE_FLASK = "raise_flask"
    EVAPORATE = "evaporate"
    """`vessel`, `seconds` or until nothing comes any more."""

    START_LIGHT = "start_light"
    STOP_LIGHT = "stop_light"
    START_ULTRASOUND = "start_ultrasound"
    STOP_ULTRASOUND = "stop_ultrasound"
    SPIN = "spin"
    MICROWAVE = "microwave"
    COLLECT_DISTILLATE = "collect_distillate"
    RUN_COLUMN = "run_column"
    RINSE_LINES = "rinse_lines"
    """`solvent`, `volume_ml`, `repeats`: flush the transfer lines into waste."""

    FLUSH_LINES = "flush_lines"
    """Push gas through the transfer lines."""

    JOIN = "join"
    """`source`, `target`: leave two places connected."""

    MEASURE = "measure"
    """`vessel`, `quantity`, `least`, `most`."""

    ADJUST = "adjust"
    """Add `reagent` in steps of `step_ml`, `most_ml` at most, until `ph` is read. `tolerance` of
    the reading, `mixing_s` after each step."""

    ASK = "ask"
    """`message`: a person answers."""

    AWAIT = "await"
    """`pid`: wait for what runs beside."""


Field = str | Decimal | int | bool | None


@dataclass(frozen=True, slots=True, kw_only=True)
class BasicOperation:
    """One basic operation, ready for a rig."""

    kind: BasicKind
    fields: Mapping[str, Field] = field(default_factory=dict)
    """Names end in their unit."""

    assumed: tuple[str, ...] = ()
    """What the recipe leaves open, with the entry of the table of defaults: `time=dry.time`."""

    place: FilePlace = field(default=NOWHERE, compare=False)


class ContentsEffect(StrEnum):
    """What an operation does to contents."""

    NONE = "none"
    ADDS = "adds"
    """A reagent comes in."""

    MOVES = "moves"
    """Contents go from one vessel to another, all or a part, as they are."""

    SPLITS = "splits"
    """Contents are parted: into phases, into solid and filtrate, into what boils and what stays."""

    CHANGES = "changes"
    """Nothing comes or goes; what is in it may react, dissolve or crystallize."""

    REMOVES = "removes"
    """Something goes to waste."""


EFFECTS: Mapping[BasicKind, ContentsEffect] = {
    BasicKind.ADD_LIQUID: ContentsEffect.ADDS,
    BasicKind.ADD_SOLID: ContentsEffect.ADDS,
    BasicKind.ADJUST: ContentsEffect.ADDS,
    BasicKind.TRANSFER: ContentsEffect.MOVES,
    BasicKind.RUN_COLUMN: ContentsEffect.SPLITS,
    BasicKind.SEPARATE_PHASES: ContentsEffect.SPLITS,
    BasicKind.DRAW_FILTRATE: ContentsEffect.SPLITS,
    BasicKind.COLLECT_DISTILLATE: ContentsEffect.SPLITS,
    BasicKind.EVAPORATE: ContentsEffect.REMOVES,
    BasicKind.START_VACUUM: ContentsEffect.REMOVES,
    BasicKind.RINSE_LINES: ContentsEffect.REMOVES,
    BasicKind.SET_TEMPERATURE: ContentsEffect.CHANGES,
    BasicKind.START_LIGHT: ContentsEffect.CHANGES,
    BasicKind.START_ULTRASOUND: ContentsEffect.CHANGES,
    BasicKind.MICROWAVE: ContentsEffect.CHANGES,
    BasicKind.SPIN: ContentsEffect.SPLITS,
}
"""Kinds that touch contents; all others do not."""
