"""The words of a plan: every field that it may have, and no other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

Text = Annotated[str, Meta(min_length=1, max_length=500)]
Sentence = Annotated[str, Meta(max_length=10_000)]
Amount = Annotated[float, Meta(ge=0, le=1e13)]
Positive = Annotated[float, Meta(gt=0, le=1e13)]
Duration = Annotated[float, Meta(ge=0, le=1e9)]
Celsius = Annotated[float, Meta(ge=-273.15, le=10_000)]
StepId = Annotated[int, Meta(ge=1)]
Percent = Annotated[float, Meta(ge=0, le=100)]
Speed = Annotated[float, Meta(gt=0, le=1e6)]


class Strict(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An object without unknown fields."""


class PlanLot(Strict, frozen=True):
    """One lot in a vessel before the first step."""

    lot: Text
    phase: Literal["liquid", "solid"]
    volume_ul: Amount | None = None
    mass_ug: Amount | None = None


class PlanRecipe(Strict, frozen=True):
    """The recipe that a plan was made from."""

    id: Text
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]


class Bindings(Strict, frozen=True):
    """Which vessel of the graph stands for which of the recipe; `chosen` where it names none."""

    vessels: dict[str, Text] = {}
    reagents: dict[str, Text | list[Text]] = {}
    chosen: list[dict[str, Text | int]] = []


class Totals(Strict, frozen=True):
    """Sums over the whole plan."""

    duration_s: Duration | None = None
    critical_path_s: Duration | None = None
    delivered_ul: dict[str, dict[str, Amount]] | None = None
    delivered_ug: dict[str, dict[str, Amount]] | None = None
    needed_ul: dict[str, Amount] | None = None
    needed_ug: dict[str, Amount] | None = None
    by_hand_count: Annotated[int, Meta(ge=0)] | None = None
    primed_ul: dict[str, Amount] | None = None


class Of(Strict, frozen=True):
    """Step of the recipe that a step of the plan comes from."""

    operation: Text
    line: int | None = None
    column: int | None = None
    act: int | None = None
    queue: str | None = None
    """Queue of the recipe; None: it is in none, and waits for all of them."""

    beside: str | None = None
    """It runs beside all that is in no queue, under this name."""


class RawAction(Strict, frozen=True):
    """An action whose parameters are not read yet."""

    device: Text
    action: Text
    parameters: dict[str, object] = {}


class RawStep(Strict, frozen=True):
    """A step whose claim and actions are not read yet."""

    id: StepId
    of: Of
    does: dict[str, object]
    actions: list[object]
    after: list[StepId]
    estimate_s: Duration
    skip_if: list[StepId] = []


class RawPlan(Strict, frozen=True):
    """A plan whose steps are not read yet."""

    plan: Literal[1]
    recipe: PlanRecipe
    graph_sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
    bindings: Bindings
    contents: dict[str, list[PlanLot]]
    capacities_ul: dict[str, Positive]
    steps: list[object]
    totals: Totals
    notes: list[Sentence]
    groups: dict[str, list[Text]] = {}
    keeps_apart: bool = False


class Parameters(Strict, frozen=True):
    """Parameters of an action; here none. A field that an action lacks reads as None."""


class ValvePort(Parameters, frozen=True):
    """Where a valve is turned to."""

    port: Text


class Stroke(Parameters, frozen=True):
    """One movement of a plunger."""

    volume_ul: Positive
    rate_ul_s: Positive


class Draw(Stroke, frozen=True):
    """A stroke that may end early."""

    until: Literal["empty", "boundary"] | None = None
    of: dict[Text, Amount] | None = None
    """Lots of the layer that it draws, in µL, as a person has stated them; unset: what is there."""

    solids: dict[Text, Amount] | None = None
    """Solid lots that go along, dissolved, in µg, as a person has stated them, and no other;
    unset: each in proportion, but for what a frit keeps back."""


class PlanWait(Parameters, frozen=True):
    """How long nothing happens."""

    duration_s: Duration


class Stirring(Parameters, frozen=True):
    """How fast something turns."""

    speed_rpm: Speed


class Temperature(Parameters, frozen=True):
    """What a heater or chiller is set to."""

    temperature_c: Celsius


class Window(Parameters, frozen=True):
    """Between which temperatures waiting ends."""

    low_c: Celsius
    high_c: Celsius


class Pressure(Parameters, frozen=True):
    """How far a pump draws a line down; unset: as far as it gets."""

    pressure_mbar: Amount | None = None


class Supply(Parameters, frozen=True):
    """What a pneumatic controller joins to a port."""

    port: Text
    supply: Literal["vacuum", "gas", "none"]


class Boiling(Parameters, frozen=True):
    """How long something is boiled down."""

    duration_s: Duration | None = None
    most_s: Duration | None = None


class Watching(Parameters, frozen=True):
    """What the reading does at the boundary; unset: any change of it counts."""

    reading: Literal["rises", "falls"] | None = None


class Light(Parameters, frozen=True):
    """What is known of a light."""

    wavelength_nm: Positive | None = None
    color: Text | None = None
    power_w: Positive | None = None
    intensity_percent: Percent | None = None


class MeasuredQuantity(Parameters, frozen=True):
    """What is measured, and between which readings it is done."""

    quantity: Text
    low: float | None = None
    high: float | None = None


class Spinning(Parameters, frozen=True):
    """How fast and how long a centrifuge spins."""

    duration_s: Duration
    speed_rpm: Speed | None = None
    acceleration_g: Speed | None = None
    temperature_c: Celsius | None = None


class Microwave(Parameters, frozen=True):
    """What microwaves heat a vessel to, and how long."""

    temperature_c: Celsius
    duration_s: Duration
    power_w: Positive | None = None


class Distilling(Parameters, frozen=True):
    """What boils over, and when it ends."""

    from_: Text = msgspec.field(name="from")
    to: Text
    duration_s: Duration | None = None
    vapour_c: Celsius | None = None


class HandFill(Parameters, frozen=True):
    """Liquid that a person fills in."""

    vessel: Text
    lot: Text
    volume_ul: Positive
    text: Sentence


class HandSolid(Parameters, frozen=True):
    """Solid that a person adds."""

    vessel: Text
    lot: Text
    mass_ug: Positive
    text: Sentence


class HandVessel(Parameters, frozen=True):
    """What a person does at a vessel."""

    vessel: Text
    text: Sentence


class HandCheck(Parameters, frozen=True):
    """What a person confirms; of a vessel, that at least so much is in it."""

    text: Sentence
    vessel: Text | None = None
    least_ul: Positive | None = None


class Become(Parameters, frozen=True):
    """What, by a person's word, comes of the lots in a vessel, there or in `to`.

    µL by lot; of solids µg, in the fields that end so.
    """

    vessel: Text
    takes: dict[Text, Amount]
    gives: dict[Text, Amount] = {}
    takes_ug: dict[Text, Amount] = {}
    gives_ug: dict[Text, Amount] = {}
    to: Text | None = None


TIMER, BY_HAND, DECLARED = "@timer", "@by_hand", "@declared"
PARAMETERS: Mapping[str, type[Parameters]] = {
    "set_port": ValvePort,
    "open": Parameters,
    "close": Parameters,
    "aspirate": Draw,
    "dispense": Stroke,
    "wait": PlanWait,
    "stir": Stirring,
    "stop_stirring": Parameters,
    "set_temperature": Temperature,
    "await_temperature": Window,
    "stop_temperature": Parameters,
    "start_vacuum": Pressure,
    "stop_vacuum": Parameters,
    "vent": Parameters,
    "set_supply": Supply,
    "start_rotation": Stirring,
    "stop_rotation": Parameters,
    "lower_flask": Parameters,
    "raise_flask": Parameters,
    "evaporate": Boiling,
    "watch_boundary": Watching,
    "stop_watching": Parameters,
    "start_light": Light,
    "stop_light": Parameters,
    "measure": MeasuredQuantity,
    "start_ultrasound": Parameters,
    "stop_ultrasound": Parameters,
    "heat_by_microwave": Microwave,
    "spin": Spinning,
    "distill": Distilling,
}
"""Action of a device → its parameters."""

HAND_PARAMETERS: Mapping[str, type[Parameters]] = {
    "fill": HandFill,
    "add_solid": HandSolid,
    "empty": HandVessel,
    "watch": HandVessel,
    "stop_watching": HandVessel,
    "check": HandCheck,
}
"""What a person does → its parameters."""

DECLARED_PARAMETERS: Mapping[str, type[Parameters]] = {"become": Become}
